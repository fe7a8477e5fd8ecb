"""What a command reads and what it is to write, told in one place: no output replaces or spoils an input.

Then what it computed, as files, a page and tables; and how to repeat it.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import click

from lava_vpr.cli.common import Parsed, console, print_whole, stage
from lava_vpr.errors import InputError, harmless, shown
from lava_vpr.images.files import IMAGE_SUFFIXES
from lava_vpr.show.page import write_page
from lava_vpr.show.table import FORMS, Table
from lava_vpr.storage.writing import new_folder, replaceable, write_atomically, written


class Outputs:
    """The outputs of one command, each found writable before any work is done, and none in the way of an input.

    An output may be no file that is read, by whatever name (a link, a hard link, another spelling); may not lie in a
    bundle, which holds its own files alone; may be no new image in a folder of images, which the next command would
    read; and may not be another output of the same command.

    Args:
        files: Files to be written, in folders that exist; None is no output.
        made: Files to be written whose folders are made if they are missing.
        folders: Folders that are replaced as a whole; whoever writes them checks them himself.
        read: Files that are read; None is no input.
        model: The model: a file, or the folder of a bundle.
        images: Folders, lists, videos and single images as the user gave them.
    Raises:
        InputError: an output that cannot be written, or that one of these rules refuses.
    """

    def __init__(
        self,
        files: Iterable[Path | None] = (),
        *,
        made: Iterable[Path | None] = (),
        folders: Iterable[Path] = (),
        read: Iterable[Path | None] = (),
        model: Path | None = None,
        images: Iterable[str] = (),
    ) -> None:
        present = tuple(path for path in files if path is not None)
        self._files = (*present, *(path for path in made if path is not None))
        self._folders = tuple(folders)
        self._refuse_equal()
        if model is not None and model.is_dir():
            self._refuse_inside(model)
        for path in self._files:
            _check_file(path, folder_is_made=path not in present)
        sources = tuple(images)
        self.spare((*(path for path in (*read, model) if path is not None), *sources))
        for source in sources:
            self._refuse_images_in(Path(source))

    def spare(self, inputs: Iterable[Path | str]) -> None:
        """Refuse an output that is one of ``inputs``, which become known later: the images of a traverse.

        Raises:
            InputError: it is one, or a folder that holds one.
        """
        standing = [(path, status) for path in self._files if (status := _status(path)) is not None]
        folders = [(path, os.path.realpath(path)) for path in self._folders if path.is_dir()]
        if not standing and not folders:
            return  # what does not exist is no input
        for source in inputs:
            status = _status(source)
            for path, own in standing:
                if status is not None and os.path.samestat(status, own):
                    raise InputError(f"{shown(path)}: is also an input, which would be replaced; name another file")
            for path, real in folders:
                if _lies_in(source, real):
                    raise InputError(
                        f"{shown(path)}: the input {shown(source)} would be replaced with it; name another folder"
                    )

    def _refuse_inside(self, bundle: Path) -> None:
        real = os.path.realpath(bundle)
        for path in (*self._files, *self._folders):
            if os.path.realpath(path) == real:
                raise InputError(f"{shown(path)}: is also the model, which would be replaced; name another place")
            if _lies_in(path, real):
                raise InputError(
                    f"{shown(path)}: would stand in the bundle {shown(bundle)}, which holds its own files alone; "
                    "name another place"
                )

    def _refuse_images_in(self, folder: Path) -> None:
        for path in self._files:
            target = Path(os.path.realpath(path))
            new = target.suffix.lower() in IMAGE_SUFFIXES and not target.name.startswith(".") and not target.exists()
            if new and target.parent == Path(os.path.realpath(folder)):
                raise InputError(
                    f"{shown(path)}: would be one more image in {shown(folder)}, which is read; name it otherwise"
                )

    def _refuse_equal(self) -> None:
        """Refuse two outputs where one is the other, or a folder on the way to it."""
        outputs = [(path, os.path.realpath(path)) for path in (*self._files, *self._folders)]
        for k, (path, real) in enumerate(outputs):
            for other, place in outputs[:k]:
                if real == place:
                    raise InputError(f"{shown(path)}: is named for two outputs; name another for one of them")
                if _lies_in(path, place) or _lies_in(other, real):
                    inner, outer = (path, other) if _lies_in(path, place) else (other, path)
                    own = f"the bundle {shown(outer)}, which holds its own files alone"
                    where = own if outer in self._folders else f"{shown(outer)}, which is to be a file"
                    raise InputError(f"{shown(inner)}: would stand in {where}; name another place")


def _status(path: Path | str) -> os.stat_result | None:
    """The status of what stands at ``path``, links followed, if anything does."""
    try:
        return os.stat(path)
    except (OSError, ValueError):
        return None


def _lies_in(path: Path | str, folder: str) -> bool:
    """Whether ``path`` is ``folder``, a path without links, or stands somewhere below it."""
    real = os.path.realpath(path)
    return real == folder or real.startswith(folder.rstrip(os.sep) + os.sep)


def _check_file(path: Path, *, folder_is_made: bool) -> None:
    """Refuse a file that cannot be written, before any work is done.

    Raises:
        InputError: its folder is missing or closed to us, it is no file, or it is read-only.
    """
    target = Path(os.path.realpath(path))
    try:
        if target.is_dir():
            raise InputError(f"{shown(path)}: is a folder; name a file")
        folder = _standing(target.parent) if folder_is_made else target.parent
        if folder_is_made and not folder.is_dir():
            raise InputError(f"{shown(folder)}: is a file; name a folder")
        replaceable(path)
        if not folder.is_dir():
            above = target.parent if path.is_symlink() else path.parent
            raise InputError(f"{shown(path)}: the folder {shown(above)} does not exist; create it first")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise InputError(f"{shown(path)}: no permission to write in {shown(folder)}; choose another place")
    except PermissionError as error:
        raise InputError(
            f"{shown(path)}: cannot be written ({error.strerror}); make it writable or name another"
        ) from None
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be written ({error.strerror}); name another") from None


def _standing(folder: Path) -> Path:
    """What exists of ``folder``: itself, or the nearest above it."""
    return next(above for above in (folder, *folder.parents) if os.path.lexists(above))


def write_text(path: Path, text: str) -> None:
    """Write a text file in one step.

    Raises:
        InputError: it cannot be written; what was there still is.
    """
    with written(path):
        write_atomically(path, lambda file: file.write(text.encode()))


@contextmanager
def file_writer(path: Path) -> Iterator[Callable[[bytes], None]]:
    """Write a file piece by piece; it appears in one step, once all is written, and not at all if that fails.

    Until then it lies on the disk of ``path`` without a name: whatever ends this process, nothing is left.

    Yields:
        What takes the next piece.
    Raises:
        InputError: it cannot be written; what was there still is.
    """
    with written(path):
        content = tempfile.TemporaryFile(dir=os.path.dirname(os.path.realpath(path)))

    def write(piece: bytes) -> None:
        with written(path):
            content.write(piece)
            content.flush()

    try:
        yield write
        with written(path):
            content.seek(0)
            write_atomically(path, lambda file: shutil.copyfileobj(content, file))
    finally:
        with suppress(OSError):  # a full disk, reported before
            content.close()


@contextmanager
def text_writer(path: Path) -> Iterator[Callable[[str], None]]:
    """`file_writer` of text."""
    with file_writer(path) as write:
        yield lambda piece: write(piece.encode())


def write_stdout(piece: str) -> None:
    """Write to standard output at once, for whoever reads along."""
    sys.stdout.write(harmless(piece) if sys.stdout.isatty() else piece)
    sys.stdout.flush()


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Write JSON so that equal values give equal bytes."""
    write_text(path, json.dumps(values, indent=2, allow_nan=False) + "\n")


Files = Mapping[Path | None, str | dict[str, Any]]
"""Text, or JSON values, by the file to write; those of None are not wanted."""


def show_results(
    said: Iterable[Table | str],
    files: Files,
    page: Path | None = None,
    page_of: Callable[[], str] = str,
    table: Path | None = None,
    figures: Path | None = None,
) -> list[Table]:
    """Write the files, then print what is said, since whoever reads it may go away.

    Args:
        said: Tables and lines, for the terminal.
        files: What is written beside.
        page: Where the page goes; None: nowhere.
        page_of: The HTML of the page.
        table: Where the first table goes, named as one of `FORMS`; None: nowhere.
        figures: Folder for the page's drawings; None: nowhere.
    Returns:
        The tables of what is said.
    """
    for path, content in files.items():
        if path is not None:
            write_text(path, content) if isinstance(content, str) else write_json(path, content)
    if page is not None:
        with stage("writing the report"):
            write_page(page_of(), page)
    if figures is not None:
        with stage("writing the figures"):
            draw_on_paper(figures, page_of)
    items = list(said)
    tables = [item for item in items if isinstance(item, Table)]
    if table is not None:
        write_text(table, FORMS[table.suffix.lower()](tables[0]).rstrip("\n") + "\n")
    for item in items:
        print_whole(item)
    for what, path in (("report", page), ("figures", figures)):
        if path is not None:
            console.print(f"{what}: {shown(path)}")
    return tables


def draw_on_paper(folder: Path, page_of: Callable[[], str]) -> None:
    """Write the drawings of the page that ``page_of`` makes to ``folder``.

    Raises:
        InputError: the path exists, or it cannot be written.
    """
    from lava_vpr.show.svg import on_paper  # matplotlib takes a second to import

    with new_folder(folder, "a folder of figures") as made, written(folder):
        made.mkdir()
        with on_paper(made):
            page_of()


SILENT = (
    "json_path",
    "csv_path",
    "table_path",
    "report_folder",
    "figures_folder",
    "output",
    "bag",
    "predictions",
    "reference_folder",
    "scores",
    "gains",
    "jobs",
    "address",
    "keep",
)
"""Parameters that a report does not repeat: they change nothing of what it says."""


def command_line(ctx: click.Context) -> str:
    """How to repeat this command, file names without their folders (reports carry no paths)."""
    words = ["lava-vpr", ctx.info_name or ""]
    for param in ctx.command.params:
        value = ctx.params.get(param.name or "")
        if value is None or value == () or value == param.default or param.name in SILENT:
            continue
        if isinstance(param.type, Parsed):
            value = tuple(map(param.type.written, value)) if param.multiple else param.type.written(value)
        values = value if isinstance(value, tuple) else (value,)
        sources = ("query", "images", "references", "stamps")
        shown = [Path(v).name if isinstance(v, Path) or param.name in sources else str(v) for v in values]
        if isinstance(param, click.Argument):
            words += shown
        elif isinstance(param, click.Option) and param.is_flag:
            words += [param.opts[-1]] if value else []
        elif param.multiple:
            words += [word for text in shown for word in (param.opts[-1], text)]
        else:
            words += [param.opts[-1], *shown]
    return shlex.join(words)
