"""Protocols by which the field compares recognisers: whose images, which are learned, which recognised, and what counts
as right; and the images of one as they lie on disk.

Each row, in `lava_vpr.datasets.protocol_rows`, holds the names that a publisher gives its images, as a rule and not as
a list, and says by which source; no image comes with this package.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from lava_vpr.errors import InputError, shown
from lava_vpr.images.files import folder_images

ANY = "*"
"""In place of names: whatever images a folder holds, naturally sorted."""


@dataclass(frozen=True)
class Names:
    """Images of one folder, by the names that their publisher gives them.

    Attributes:
        folder: The folder, below that of the dataset.
        name: The name of an image, with ``{}`` for its number; or `ANY`.
        numbers: Their numbers, in order.
    """

    folder: str
    name: str
    numbers: tuple[range, ...]

    def __len__(self) -> int:
        return sum(map(len, self.numbers))

    def listed(self) -> list[str]:
        """The name of each image, none if any will do."""
        return [] if self.name == ANY else [self.name.format(k) for some in self.numbers for k in some]

    @property
    def sha256(self) -> str:
        """The SHA-256 of the names, a line each without one at the end, as 64 hexadecimal digits."""
        return hashlib.sha256("\n".join(self.listed()).encode()).hexdigest()

    def there(self, root: Path) -> dict[int, Path]:
        """The images that are there, by their place in the list, from 0.

        Raises:
            InputError: the folder cannot be read, holds no image, or more than the publisher's.
        """
        folder = root / self.folder
        paths = folder_images(folder)
        if self.name != ANY:
            present = set(map(os.path.basename, paths))
            return {k: folder / name for k, name in enumerate(self.listed()) if name in present}
        if len(paths) > len(self):
            more = f"{len(paths):,} images, the protocol {len(self):,}"
            raise InputError(f"{shown(folder)}: holds {more}; take out those that are not the publisher's")
        return {k: Path(path) for k, path in enumerate(paths)}


@dataclass(frozen=True)
class ProtocolLayout:
    """One way in which the images of a protocol lie on disk.

    Attributes:
        references: What is learned, folder after folder.
        queries: What is recognised.
        truth: A file of the publisher's that says which places are right, as ``eval --gt`` takes it; None: query k
            shows reference k times `Protocol.every`.
    """

    references: tuple[Names, ...]
    queries: tuple[Names, ...]
    truth: str | None = None

    @property
    def folders(self) -> list[str]:
        """All folders, references first, and the file of the truth."""
        return [names.folder for names in (*self.references, *self.queries)] + ([self.truth] if self.truth else [])


class Published(NamedTuple):
    """Figures that somebody printed.

    Attributes:
        method: What reached them.
        recall: R@1, R@5 and R@10 in percent; None where one is not printed.
        pixels: Width and height of the images that it sees, as far as the source says.
        parameters: As far as the source says.
        source: Where they are printed.
    """

    method: str
    recall: tuple[float | None, float | None, float | None]
    source: str
    pixels: str = ""
    parameters: str = ""


@dataclass(frozen=True)
class Protocol:
    """A protocol.

    Attributes:
        name: By what name users choose it.
        title: What it is called in words.
        layouts: The ways in which its images may lie on disk, in the order in which they are tried.
        tolerance: Places by which an answer may be off.
        page: Who distributes the images.
        sources: Where names, pairs and tolerance are from.
        every: References from the place of one query to that of the next.
        unsaid: What the sources do not say, or say in two ways.
        published: Figures of others.
        learn: Words for ``lava-vpr train``.
    """

    name: str
    title: str
    layouts: tuple[ProtocolLayout, ...]
    tolerance: int
    page: str
    sources: tuple[str, ...]
    every: int = 1
    unsaid: str = ""
    published: tuple[Published, ...] = ()
    learn: tuple[str, ...] = ()

    @property
    def sizes(self) -> tuple[int, int]:
        """How many images are learned, and how many recognised."""
        layout = self.layouts[0]
        return sum(map(len, layout.references)), sum(map(len, layout.queries))


class FoundImages(NamedTuple):
    """The images of a protocol as they lie on disk.

    Attributes:
        protocol: Its row.
        references, queries: The images, by their place in the publisher's list.
        truth: The publisher's file that says which places are right, if there is one.
    """

    protocol: Protocol
    references: dict[int, Path]
    queries: dict[int, Path]
    truth: Path | None

    @property
    def whole(self) -> bool:
        """Whether all images of the protocol are there."""
        return (len(self.references), len(self.queries)) == self.protocol.sizes

    def right(self) -> Iterator[list[int]]:
        """Of each query, the references that are right, by their order among those that are there."""
        rows = {number: row for row, number in enumerate(self.references)}
        for query in self.queries:
            place, off = query * self.protocol.every, self.protocol.tolerance
            yield [rows[k] for k in range(place - off, place + off + 1) if k in rows]


def find_images(protocol: Protocol, root: Path, *, part: bool = False) -> FoundImages:
    """The images of ``protocol`` below ``root``.

    Args:
        protocol: The row of one.
        root: The folder of the dataset.
        part: Whether some of the images are enough.
    Raises:
        InputError: no layout is there, images are missing, or a query whose place is.
    """
    missing = []
    for layout in protocol.layouts:
        absent = [name for name in layout.folders if not (root / name).exists()]
        if not absent:
            return _found(protocol, layout, root, part and layout.truth is None)
        missing.append(" + ".join(f"{name} (missing)" if name in absent else name for name in layout.folders))
    raise InputError(
        f"{shown(root)}: does not hold the images of {protocol.name}; it needs {', or '.join(missing)}; get them "
        f"from {protocol.page}"
    )


def _found(protocol: Protocol, layout: ProtocolLayout, root: Path, part: bool) -> FoundImages:
    """The images of ``layout``, whose folders exist."""
    references, queries = (_side(side, root, protocol, part) for side in (layout.references, layout.queries))
    found = FoundImages(protocol, references, queries, None if layout.truth is None else root / layout.truth)
    alone = [] if found.truth else [k for k in found.queries if k * protocol.every not in found.references]
    if alone:
        raise InputError(
            f"{shown(found.queries[alone[0]])}: shows a place of which there is no reference, and so do "
            f"{len(alone) - 1:,} other queries of {len(found.queries):,}; add their references, or take them out"
        )
    return found


def _side(side: Sequence[Names], root: Path, protocol: Protocol, part: bool) -> dict[int, Path]:
    """The images of the references, or of the queries, by their place in the list.

    Raises:
        InputError: there are none, or too few.
    """
    found: dict[int, Path] = {}
    first = 0
    for names in side:
        there = names.there(root)
        found |= {first + k: path for k, path in there.items()}
        first += len(names)
        if len(there) < len(names) and not (part and found):
            lost = next((name for k, name in enumerate(names.listed()) if k not in there), None)
            which = f" ({lost} is the first that is missing)" if lost and there else ""
            also = ", or give --part to take those that are there" if there else ""
            raise InputError(
                f"{shown(root / names.folder)}: holds {len(there):,} of the {len(names):,} images of {protocol.name}"
                f"{which}; complete them from {protocol.page}{also}"
            )
    return found
