"""Figures kept by content: under a hash of all that decides them, the sources of the modules that compute them, too.

Which modules these are is read from their import statements, beginning with the module of the task's function; no list
is kept by hand. A module whose name is put together while the program runs is not seen: Lava's Processes, and plug-ins.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from lava_vpr.cluster.connection import that_compute
from lava_vpr.errors import InputError, shown
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.writing import write_atomically

T = TypeVar("T")
P = TypeVar("P", contravariant=True)
R = TypeVar("R")

ROOTS = ("lava_vpr.processes", "lava_vpr.deploy", "lava_vpr", "benchmarks")
"""Packages whose sources decide figures; the first two may lie elsewhere than the third."""


@cache
def _folders(root: str) -> tuple[Path, ...]:
    """Where a package lies; nowhere if it is not installed."""
    try:
        spec = find_spec(root)
    except ModuleNotFoundError:
        return ()
    return tuple(map(Path, (spec and spec.submodule_search_locations) or ()))


@cache
def source_file(module: str) -> Path | None:
    """The file of a module of `ROOTS`, found without importing it; None if there is no such module."""
    root = next((root for root in ROOTS if f"{module}.".startswith(f"{root}.")), None)
    if root is None:
        return None
    parts = module.split(".")[root.count(".") + 1 :]
    for folder in _folders(root):
        place = folder.joinpath(*parts)
        for file in (place / "__init__.py", place.with_name(f"{place.name}.py")):
            if file.is_file():
                return file
    return None


def _imported(node: ast.AST) -> Iterator[str]:
    """Names that may be modules among the imports of a syntax tree, those for type checkers alone left out."""
    if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
        children: Iterable[ast.AST] = node.orelse
    else:
        children = ast.iter_child_nodes(node)
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module is not None:
        yield node.module
        yield from (f"{node.module}.{alias.name}" for alias in node.names)
    for child in children:
        yield from _imported(child)


@cache
def _read(module: str) -> tuple[str, frozenset[str]]:
    """What a module does, without docstrings, comments and layout, and the names that it imports."""
    file = source_file(module)
    tree = ast.parse(b"" if file is None else file.read_bytes())
    names = frozenset(_imported(tree))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [part for part in body if not _is_text(part)]  # type: ignore[attr-defined]
    return ast.dump(tree), names


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def modules_of(function: Callable[..., Any]) -> list[str]:
    """Names of the modules of `ROOTS` that a function's module imports, directly or through others, itself included."""
    while isinstance(function, partial):
        function = function.func
    found, due = set[str](), [function.__module__]
    while due:
        name = due.pop()
        if name in found or source_file(name) is None:
            continue
        found.add(name)
        due += [*_read(name)[1], name.rpartition(".")[0]]  # importing a module runs the packages that it is in
    return sorted(found)


def sources_hash(function: Callable[..., Any]) -> str:
    """A hash of the sources that decide what a function returns; docstrings, comments and layout do not count."""
    text = json.dumps([[name, _read(name)[0]] for name in modules_of(function)])
    return hashlib.sha256(text.encode()).hexdigest()


def content_key(function: Callable[..., Any], decides: Any, *inputs: bytes) -> str:
    """The key of what ``function`` returns.

    Args:
        function: The task, a function of a module.
        decides: Settings, seed and whatever else decides, as plain JSON values.
        inputs: Hashes of the inputs, in order.
    """
    digest = hashlib.sha256(json.dumps([sources_hash(function), that_compute(), decides], sort_keys=True).encode())
    for part in inputs:
        digest.update(part)
    return digest.hexdigest()


def _digest(key: str, figures: Any) -> str:
    """A checksum of figures and of what they are of."""
    return hashlib.sha256(json.dumps([key, figures], sort_keys=True).encode()).hexdigest()


class Cache(Protocol[P, R]):
    """Where the figures of points are kept."""

    def key(self, point: P, /) -> str:
        """The key of a point's figures (`content_key`), asked for before they are computed."""

    def find(self, point: P, key: str, /) -> R | None:
        """The figures of a point that are kept under ``key``; None if there are none."""

    def keep(self, point: P, key: str, figures: R, /) -> None:
        """Keep the figures of a point."""


@dataclass(frozen=True)
class FigureCache(Generic[T, R]):
    """A folder with a file for each task whose figures are known.

    Attributes:
        folder: The folder, made when the first figures are kept.
        name: The name of a task's file, without its ending.
        key: The key of a task's figures (`content_key`), asked for before they are computed.
        figures: Makes the figures of a task of the JSON values in a file; ValueError, TypeError or KeyError if they are
            none.
    """

    folder: Path
    name: Callable[[T], str]
    key: Callable[[T], str]
    figures: Callable[[T, Any], R]

    def file(self, task: T) -> Path:
        """Where the figures of a task are kept."""
        return self.folder / f"{self.name(task)}.json"

    def find(self, task: T, key: str) -> R | None:
        """The figures of a task that are kept under ``key``; None if there are none, or they cannot be read.

        Nothing in a file is trusted but figures of the form that is written, with their checksum.
        """
        path = self.file(task)
        if not path.is_file():
            return None
        try:
            values = parse_json(read_bytes(path, "text_bytes"))
            sound = (values["fingerprint"], values["sha256"]) == (key, _digest(key, values["figures"]))
            return self.figures(task, values["figures"]) if sound else None
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return None

    def keep(self, task: T, key: str, figures: R) -> None:
        """Keep the figures of a task.

        Raises:
            InputError: the folder or file cannot be written.
        """
        path = self.file(task)
        text = json.dumps({"fingerprint": key, "sha256": _digest(key, figures), "figures": figures}) + "\n"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, lambda file: file.write(text.encode()))
        except OSError as error:
            raise InputError(
                f"{shown(path)}: cannot be kept ({error.strerror}); name another folder with --keep"
            ) from None
