"""What happens when the program is stopped: by Ctrl-C, SIGTERM, or SIGHUP when its terminal is closed.

`install` is for the program alone. It lets all three unwind the program as Ctrl-C does, so that everything that stands
in a ``finally`` is done. `held` serves the library, too: within it nothing is interrupted.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TypeVar

T = TypeVar("T")

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""The signals that ask a program to end."""


standing: set[Path] = set()
"""Temporary folders that exist; `finish` removes those that a signal kept a block from removing."""

SOON = 0.05  # seconds until a signal that was lost comes again


_STACK = 64 << 20
"""Bytes of the stack of a thread for `stoppable`; libraries that go down into what a file nests need more than the half
to eight megabytes that systems set aside."""


class StoppedError(KeyboardInterrupt):
    """Raised in the main thread when a signal asks the program to end; whatever minds Ctrl-C minds it."""


class _SignalState:
    """What a signal does just now."""

    def __init__(self) -> None:
        self.depth = 0  # blocks of `held` that we are in
        self.begun = True  # False: most of what a command needs is still to be loaded
        self.working = True  # False: there is nothing that would have to be ended in good order
        self.telling = False  # True: the signal that stopped the program is being reported
        self.waiting: list[int] = []  # signals that are held back
        self.stopped: list[int] = []  # signals that stopped the program
        self.lost: list[int] = []  # signals that stopped nothing, and come again


_now = _SignalState()


def _stop(number: int, frame: FrameType | None) -> None:
    """Unwind the program; or end it at once if it is doing nothing; or take note if it is not to be disturbed."""
    if _now.telling:
        pass
    elif _now.depth:
        _now.waiting.append(number)
    elif _now.working:
        _now.stopped.append(number)
        raise StoppedError
    elif number == signal.SIGINT:
        if not _now.stopped:  # else it is reported already
            with suppress(OSError):
                os.write(2, b"\nAborted!\n")
        os._exit(1)
    else:
        _die_of(number)


def _die_of(number: int) -> None:
    """End by a signal, so that whoever started the program sees what it died of."""
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


def install() -> None:
    """Mind the signals, from the main thread; one that is ignored, as by ``nohup``, stays ignored.

    Until `begin` a signal ends the program at once: an exception out of the import of a compiled module can turn into
    any other.
    """
    _now.begun = _now.working = False
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _stop)
    sys.unraisablehook = _unraisable


def _unraisable(what: sys.UnraisableHookArgs) -> None:
    """Be silent about what an interrupt breaks where nothing can be raised; one that was lost there comes again."""
    if _now.stopped and isinstance(what.exc_value, StoppedError):
        _now.lost.append(_now.stopped.pop())
        if len(_now.lost) == 1:
            again = threading.Timer(SOON, _come_again)
            again.daemon = True
            again.start()
    elif not _now.stopped:  # else it was made by half
        sys.__unraisablehook__(what)


def _come_again() -> None:
    """Send the first signal that was lost, unless another one stops the program by now: it would disturb that."""
    number = _now.lost[0]
    _now.lost.clear()
    if not _now.stopped:
        os.kill(os.getpid(), number)


def begin() -> None:
    """From now on a signal raises `StoppedError`."""
    _now.begun = _now.working = True


def begun() -> bool:
    """Whether `begin` was called, or `install` was not."""
    return _now.begun


def tell() -> None:
    """Keep further signals from cutting short the report of the first one, if `install` was called."""
    _now.telling = any(signal.getsignal(number) is _stop for number in SIGNALS)


def over() -> None:
    """Work is over: from now on a signal ends the program at once."""
    _now.working = _now.telling = False


@contextmanager
def minded() -> Iterator[None]:
    """Raise again a stop signal that a library has swallowed.

    A class that is being made, and the import of a compiled module, raise an exception of their own in place of ours.
    """
    try:
        yield
    except Exception:
        if _now.stopped:
            raise StoppedError from None
        raise


def finish() -> None:
    """Remove temporary folders that are left, then end by the signal that stopped the work, unless it was Ctrl-C."""
    for folder in standing:
        shutil.rmtree(folder, ignore_errors=True)
    for fatal in _now.stopped:
        if fatal != signal.SIGINT:
            _die_of(fatal)


def stoppable(call: Callable[[], T], seconds: float | None = None) -> T:
    """What ``call`` returns or raises; a signal is handled at once even where a library does not return.

    Python handles signals between its own steps, and so never within a library that does not return. The call is made
    in another thread, which a signal leaves behind; it ends with the program.

    Args:
        call: What is called.
        seconds: Time that it may take; None: any.
    Raises:
        concurrent.futures.TimeoutError: it takes longer; it is left behind.
        Exception: what it raises.
    """
    future: Future[T] = Future()

    def work() -> None:
        try:
            future.set_result(call())
        except BaseException as error:
            future.set_exception(error)

    thread = threading.Thread(target=work, daemon=True)
    before = threading.stack_size(_STACK)
    try:
        thread.start()
    finally:
        threading.stack_size(before)
    return future.result(seconds)


@contextmanager
def held() -> Iterator[None]:
    """Hold signals back until the end of the block: what it makes is known by then, what it removes is gone.

    Where `install` was not called, that is Ctrl-C alone; and nothing in other threads, which signals do not interrupt.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _now.depth += 1
    handler = signal.getsignal(signal.SIGINT)
    foreign = callable(handler) and handler is not _stop
    try:
        if foreign:
            signal.signal(signal.SIGINT, _stop)
        yield
    finally:
        _now.depth -= 1
        if foreign:
            signal.signal(signal.SIGINT, handler)
        if _now.waiting and not _now.depth:
            number = _now.waiting[0]
            _now.waiting.clear()
            signal.raise_signal(number)
