"""The group of all commands: imports a command when it is used, and turns errors into one line."""

from __future__ import annotations

import errno
import importlib
import logging
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import click

from lava_vpr import interrupts
from lava_vpr.errors import ConfigError, LavaVprError, UsageError, brief, harmless, shown
from lava_vpr.kernelcache import COMPILING, COMPILING_TEXT
from lava_vpr.storage.limits import check_variables

_SPACE = "free some space"
_REMEDIES = {
    errno.ENOSPC: _SPACE,
    errno.EDQUOT: _SPACE,
    errno.EFBIG: "raise the limit on the size of files (ulimit -f)",
    errno.EMFILE: "raise the limit on open files (ulimit -n)",
    errno.ENFILE: "end other programs, which hold too many files open",
    errno.EAGAIN: "end other programs, or raise the limit on processes (ulimit -u)",
    errno.ENOMEM: "free some memory, or raise the limit on it (ulimit -v)",
}
"""Remedies for errors of the system by number; for others the path and its permissions are checked."""

_NO_THREAD = "can't start new thread"  # all that `threading` says, as a RuntimeError
_NO_MEMORY = ("failed to map segment", "cannot allocate memory", "Could not find/load shared object")


class OneLineGroup(click.Group):
    """Turns every error that a user can cause into one line on stderr and exit code 1.

    Whatever else is raised is a defect of ours, and is shown as it is.
    """

    def main(self, *args: Any, **options: Any) -> Any:
        """Run the program; what fails before a command begins, as ``--version`` to a full disk, is one line, too."""
        try:
            with _told_in_one_line():
                return super().main(*args, **options)
        except _Failure as failure:
            failure.show()
            sys.exit(failure.exit_code)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """See `click.Group`; a command that is misspelt is named."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            from difflib import get_close_matches  # only who errs waits for it

            near = get_close_matches(args[0], self.list_commands(ctx), n=1)
            if near:
                ctx.fail(f"{error.message} Did you mean {near[0]!r}?")
            raise

    def invoke(self, ctx: click.Context) -> Any:
        notes, logger = _Notes(), logging.getLogger("lava_vpr")
        logger.addHandler(notes)
        logger.setLevel(logging.INFO)
        try:
            with _told_in_one_line(), interrupts.minded():
                check_variables()
                _check_opencv()
                return super().invoke(ctx)
        except KeyboardInterrupt:
            interrupts.tell()
            raise
        except UsageError as error:
            name = ctx.invoked_subcommand or ""
            command = self.get_command(ctx, name) or self
            raise click.UsageError(str(error), click.Context(command, ctx, name)) from None
        finally:
            logger.removeHandler(notes)


@contextmanager
def _told_in_one_line() -> Iterator[None]:
    """Turn what the user or the machine is to blame for into a `_Failure`."""
    try:
        yield
    except UsageError:
        raise
    except LavaVprError as error:
        raise _Failure(str(error)) from None
    except BrokenPipeError:
        # The reader of our output went away (`lava-vpr eval ... | head`): not an error of ours or theirs.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(0) from None
    except OSError as error:
        raise _Failure(_told(error)) from None
    except MemoryError as error:
        raise _Failure(_out_of_memory(str(error))) from None
    except ImportError as error:
        if (error.name or "").partition(".")[0] == __name__.partition(".")[0]:
            raise
        if any(words in str(error) for words in _NO_MEMORY):
            raise _Failure(_out_of_memory(str(error))) from None
        raise _Failure(
            f"a part that lava-vpr needs cannot be loaded ({error}); install it again: "
            "pip install --force-reinstall lava-vpr"
        ) from None
    except RuntimeError as error:
        if str(error) != _NO_THREAD:
            raise
        remedy = "end other programs, or raise the limit on processes (ulimit -u) or memory (ulimit -v)"
        raise _Failure(f"no further thread can be started; {remedy}") from None


def _check_opencv() -> None:
    """See that OpenCV starts where variables tell it how: it ends the process over one that it cannot read.

    What fails without these variables, too, as for want of memory or open files, is no fault of theirs, and is told
    where it is missed.

    Raises:
        ConfigError: it does not.
    """
    told = [f"{name} is {brief(value)}" for name, value in os.environ.items() if name.startswith("OPENCV_")]
    if not told:
        return
    from subprocess import SubprocessError

    from lava_vpr.isolated.child import run_child

    words = (
        "import sys; sys.path.pop(0); import cv2; cv2.resize(cv2.UMat(9, 9, 0).get(), (5, 5))"  # no cv2.py from here
    )
    without = {name: value for name, value in os.environ.items() if not name.startswith("OPENCV_")}
    try:
        tried = run_child([sys.executable, "-c", words], seconds=60)
        if not tried.code or run_child([sys.executable, "-c", words], seconds=60, environment=without).code:
            return
    except (OSError, SubprocessError):
        return
    raise ConfigError(f"OpenCV cannot start ({tried.last}); correct or unset its variables: {', '.join(told)}")


@contextmanager
def _loading(command: str) -> Iterator[None]:
    """Say on a terminal that a command is being loaded; on a busy machine that takes seconds, and nothing is there yet.

    Kernels whose types are known are compiled meanwhile, on the first run.
    """
    if not sys.stderr.isatty():
        yield
        return

    def say(text: str) -> None:
        with suppress(OSError):
            sys.stderr.write(f"\r\x1b[2K{text}")
            sys.stderr.flush()

    def told(begun: bool) -> None:
        say(COMPILING_TEXT if begun else f"loading {command}")

    say(f"loading {command}")
    COMPILING.append(told)
    try:
        yield
    finally:
        COMPILING.remove(told)
        say("")


def _told(error: OSError) -> str:
    """An error of the system in one line: its path, its cause, a remedy."""
    where = f"{shown(os.fsdecode(error.filename))}: " if isinstance(error.filename, (str, bytes)) else ""
    if any(words in str(error) for words in _NO_MEMORY):
        return _out_of_memory(str(error))
    if error.errno == errno.ENOENT and not where and _homeless():
        return "the working directory does not exist any more; change to another"
    remedy = _REMEDIES.get(error.errno or 0, "check the path and its permissions")
    return f"{where}{error.strerror or error}; {remedy}"


def _homeless() -> bool:
    """Whether the folder that we work in has been removed."""
    try:
        os.getcwd()
    except OSError:
        return True
    return False


def _out_of_memory(said: str) -> str:
    """The message when memory ran out: what could not be had, if that is known, and all that may help."""
    what = f" ({said})" if said else ""
    return (
        f"not enough memory{what}; end other programs, raise the limit on it (ulimit -v), or give fewer or smaller "
        "images at a time"
    )


class _Notes(logging.Handler):
    """Prints what the library notes on stderr, each on one line; of a ``sort`` that many files may give, the first."""

    def __init__(self) -> None:
        super().__init__()
        self._told: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        sort = getattr(record, "sort", None)
        if sort in self._told:
            return
        if sort is not None:
            self._told.add(sort)
        with suppress(OSError):  # where notes cannot be written, work goes on
            click.echo(f"note: {_one_line(record.getMessage())}", err=True)


class _Failure(click.ClickException):
    """A message on one line, whatever file names it holds."""

    exit_code = 1

    def show(self, file: Any = None) -> None:
        with suppress(OSError):  # the exit code is left to tell
            click.echo(f"lava-vpr: error: {_one_line(self.format_message())}", err=True)


def _one_line(text: str) -> str:
    """``text`` on one line, without anything that a terminal would obey."""
    return harmless(" ".join(text.split()))


class LazyGroup(OneLineGroup):
    """A group that knows its commands by name and one-line help, so that ``--help`` answers at once.

    Args:
        table: The module of each command by its name, the function's name there, and the one-line help.
    """

    def __init__(self, *args: Any, table: Mapping[str, tuple[str, str, str]], **options: Any) -> None:
        super().__init__(*args, **options)
        self.table = table

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.table:
            return None
        module, attribute, _ = self.table[cmd_name]
        with _loading(cmd_name):
            command = getattr(importlib.import_module(module), attribute)
        if not isinstance(command, click.Command):
            raise TypeError(f"{module}.{attribute} is no command")
        interrupts.begin()  # all that a command needs is loaded, most of it
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_text) for name, (_, _, help_text) in self.table.items()])
