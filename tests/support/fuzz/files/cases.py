"""A case: a seed and a number decide which honest file is changed, and how.

Used by storage and support.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from support.fuzz.files import bundles, containers, lists, texts
from support.fuzz.files.corpus import Corpus

SHARES = {"model": 34, "bundle": 28, "checkpoint": 12, "settings": 12, "list": 14}
"""Cases of each format, in percent."""


@dataclass(frozen=True)
class Case:
    """A changed file or folder.

    Attributes:
        seed, number: What decides everything else.
        format: A key of `SHARES`.
        honest: Name of the file that was changed.
        told: What was changed.
        files: Contents by name; a single file, or those of a bundle.
        draw: In [0, 1); decides which commands are tried with it.
    """

    seed: int
    number: int
    format: str
    honest: str
    told: str
    files: dict[str, bytes] = field(repr=False)
    draw: float

    @property
    def title(self) -> str:
        """The case in one line."""
        return f"{self.format} {self.honest}, seed {self.seed}, number {self.number}: {self.told}"


def make(corpus: Corpus, seed: int, number: int) -> Case:
    """Case ``number`` of ``seed``."""
    rng = random.Random(f"{seed}/{number}")
    kind = rng.choices(list(SHARES), list(SHARES.values()))[0]
    if kind == "bundle":
        honest = rng.choice(sorted(corpus.bundles))
        files, told = bundles.changed(rng, corpus.bundles[honest], corpus.bundles)
    elif kind == "list":
        honest = rng.choice(sorted(lists.HONEST))
        data, told = lists.changed(rng, honest)
        files = {honest: data}
    elif kind == "settings":
        honest = rng.choice(sorted(corpus.texts))
        data, told = texts.changed(rng, corpus.texts[honest])
        files = {"settings.toml": data}
    else:
        honest_files = corpus.models if kind == "model" else corpus.checkpoints
        honest = rng.choice(sorted(honest_files))
        data, told = containers.changed(rng, honest_files[honest], honest_files)
        files = {"m.lvpr" if kind == "model" else "n.lvpr.checkpoint": data}
        if rng.random() < 0.01:
            special = rng.choice([b"fifo", b"folder", b"missing", b"link /dev/zero", b"link /dev/null"])
            files, told = {name: bundles.RAW_MARK + special for name in files}, special.decode()
    return Case(seed, number, kind, honest, told, files, rng.random())
