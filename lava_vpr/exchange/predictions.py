"""Answers as the program VPR-methods-evaluation writes its predictions: a text file for each query.

Source: https://github.com/gmberton/VPR-methods-evaluation (visualizations.py, ``save_file_with_paths``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from lava_vpr.matches import Match
from lava_vpr.storage.writing import new_folder, written
from lava_vpr.traverse import Traverse

Write = Callable[[Traverse, list[Match]], None]
"""Takes some queries and the answers to them."""


@contextmanager
def prediction_writer(path: Path, references: Path | None = None) -> Iterator[Write]:
    """Write a file for each query, ``000.txt`` for the first; the folder appears once all are written.

    A file has the path of the query, and those of the best places, best first, each on a line of its own.

    Args:
        path: The folder, which must not exist.
        references: Folder of the reference images; None: places have the names of their images, without a folder.
    Yields:
        What takes the next answers, in order.
    Raises:
        InputError: something stands at ``path``, or it cannot be written.
    """
    with new_folder(path, "a folder of predictions") as folder:
        with written(path):
            folder.mkdir()
        number = 0

        def write(some: Traverse, found: list[Match]) -> None:
            nonlocal number
            queries = some.paths if some.frames is None else some.names
            for query, match in zip(queries, found, strict=True):
                names = [one.name for one in match.candidates] or [match.name] * (match.place >= 0)
                places = [name if references is None else str(references / name) for name in names]
                text = "\n".join(["Query path:", query, "", "Predictions paths:", *places, ""])
                with written(path):
                    (folder / f"{number:03d}.txt").write_text(text, encoding="utf-8", errors="surrogateescape")
                number += 1

        yield write
