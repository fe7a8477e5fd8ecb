"""The program ``lava-vpr``, also as ``python -m lava_vpr``: minds signals and mends streams before anything else."""

from __future__ import annotations

import atexit
import io
import os
import sys
from contextlib import suppress
from typing import Any

from lava_vpr import interrupts
from lava_vpr.kernelcache import COMPILING, note_compiling


class Output(io.TextIOWrapper):
    """An output stream that takes any text, and is named by its errors.

    What its encoding lacks is printed as its escape, and so are the bytes of file names that are no text.
    """

    def __init__(self, name: str, number: int, like: Any) -> None:
        if like is None:  # it is closed
            super().__init__(open(number, "wb", closefd=False), "utf-8", "backslashreplace")
        else:
            how = (like.encoding, "backslashreplace", None, like.line_buffering, like.write_through)
            super().__init__(like.detach(), *how)
        self.called = name

    def write(self, text: str) -> int:
        """See `io.TextIOWrapper.write`."""
        try:
            return super().write(text)
        except OSError as error:
            error.filename = self.called
            raise

    def flush(self) -> None:
        """See `io.TextIOWrapper.flush`."""
        try:
            super().flush()
        except OSError as error:
            error.filename = self.called
            raise


def run() -> None:
    """Run the command that the arguments name, and exit.

    Once all that stands in a ``finally`` or in `atexit` is done, the process ends without taking the interpreter apart:
    that takes half as long as a short command, and a signal in it would call work failed that is done.
    """
    interrupts.install()
    mend_streams()
    COMPILING.append(note_compiling)
    os.environ.update(MPLBACKEND="agg", MATPLOTLIBRC=os.devnull)  # drawings are files, and the same for everybody
    code: object = 1
    whole: list[int] = []  # the exit code, when nothing more is to be reported
    atexit.register(_end, whole)  # the first to be registered is the last to be called
    try:
        try:
            from lava_vpr.cli import main

            main(prog_name="lava-vpr")
        except SystemExit as ending:
            code = ending.code
    except KeyboardInterrupt:  # a second one, while the first was being reported; or when all was done
        pass
    finally:
        interrupts.over()
        try:
            sys.stdout.flush()
        except (OSError, ValueError):  # reported already; Python would report it again
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        interrupts.finish()
    if isinstance(code, int) and not interrupts.begun():
        os._exit(code)  # a library that was loaded by half, for want of memory, may wait for ever in its own ending
    if isinstance(code, int):
        whole.append(code)
    sys.exit(code)  # type: ignore[arg-type]


def _end(whole: list[int]) -> None:
    """End the process with the exit code in ``whole``, if there is one."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    with suppress(OSError, ValueError):
        sys.stderr.flush()
    if whole:
        os._exit(whole[0])


def mend_streams() -> None:
    """Open streams that are closed on nothing, so that no file of ours takes their place; let any text be printed."""
    for number in range(3):
        with suppress(OSError):
            os.fstat(number)
            continue
        os.open(os.devnull, os.O_RDWR)  # the lowest number that is free, which is this one
    streams = {
        "stdin": sys.stdin or open(0, closefd=False, encoding="utf-8"),
        "stdout": Output("stdout", 1, sys.stdout),
        "stderr": Output("stderr", 2, sys.stderr),
    }
    for name, stream in streams.items():
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)


if __name__ == "__main__":
    run()
