"""The group of all commands: imports a command when it is used, and turns errors into one line."""

from __future__ import annotations

import errno
import importlib
import logging
import os
import sys
from collections.abc import Mapping
from typing import Any

import click

from lava_vpr.errors import LavaVprError


class OneLineGroup(click.Group):
    """Turns every error that a user can cause into one line on stderr and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        notes, logger = _Notes(), logging.getLogger("lava_vpr")
        logger.addHandler(notes)
        try:
            return super().invoke(ctx)
        except LavaVprError as error:
            raise _Failure(str(error)) from None
        except BrokenPipeError:
            # The reader of our output went away (`lava-vpr eval ... | head`): not an error of ours or theirs.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise SystemExit(0) from None
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            remedy = "free some space" if error.errno == errno.ENOSPC else "check the path and its permissions"
            raise _Failure(f"{where}{error.strerror or error}; {remedy}") from None
        except MemoryError:
            raise _Failure("not enough memory; use fewer images at a time (--places A:B)") from None
        finally:
            logger.removeHandler(notes)


class _Notes(logging.Handler):
    """Prints each warning of the library as a note on stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        click.echo(f"note: {record.getMessage()}", err=True)


class _Failure(click.ClickException):
    """A message on one line, whatever file names it holds."""

    exit_code = 1

    def show(self, file: Any = None) -> None:
        text = " ".join(self.format_message().split())
        click.echo(f"lava-vpr: error: {text}", err=True)


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
        command = getattr(importlib.import_module(module), attribute)
        if not isinstance(command, click.Command):
            raise TypeError(f"{module}.{attribute} is no command")
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_text) for name, (_, _, help_text) in self.table.items()])
