"""One section by one network: what it needs is read here, and measured by any process."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.rivals import BASELINES
from lava_vpr.config import Config, preset
from lava_vpr.configfile import to_dict
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse
from lava_vpr.errors import InputError
from lava_vpr.experiments.cache import FigureCache, content_key
from lava_vpr.matching.baselines import cosine_similarities, load_descriptors
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.model import decode
from lava_vpr.paper_table.methods import DESCRIPTORS, of_network
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.storage.reading import open_regular
from lava_vpr.storage.text import shown
from lava_vpr.training.loop import train
from lava_vpr.traverse import Traverse, open_traverse


@dataclass(frozen=True)
class Taken:
    """Some images of a traverse, as plain values.

    Attributes:
        source: Folder, list or video.
        every: Seconds between two frames of a video.
        indices: Their numbers in the whole traverse, in order.
    """

    source: str
    every: float
    indices: tuple[int, ...] = field(repr=False)

    def open(self) -> Traverse:
        """The images.

        Raises:
            InputError: the traverse cannot be opened any more.
        """
        whole = open_traverse(self.source, every=self.every)
        if max(self.indices) >= len(whole):
            raise InputError(f"{shown(self.source)}: has {len(whole)} images, fewer than before; start again")
        return whole.take(self.indices)

    def read(self, config: Config) -> EncodedTraverse:
        """The images as a network of ``config`` sees them, with what baselines compare."""
        return encode_traverse(self.open(), config.encoder, Keep.ALL)

    def digest(self) -> bytes:
        """A hash of the files of the images, and of which frames of a video they are.

        Raises:
            InputError: a file cannot be read.
        """
        traverse = self.open()
        frames = [] if traverse.frames is None else traverse.frames.tolist()
        digest = hashlib.sha256(json.dumps([self.every, frames]).encode())
        for path in map(Path, traverse.paths):
            try:
                with open_regular(path) as file:
                    while block := file.read(1 << 20):
                        digest.update(block)
            except OSError as error:
                raise InputError(f"{shown(path)}: cannot be read ({error.strerror}); check the file") from None
        return digest.digest()


@dataclass(frozen=True)
class DescriptorRows:
    """Rows of a file of descriptors.

    Attributes:
        path: The .npy file.
        rows: Which rows, in order.
    """

    path: Path
    rows: tuple[int, ...] = field(repr=False)

    def read(self, config: Config | None = None) -> NDArray[np.float64]:
        """The rows, float64 (n, dimensions).

        Raises:
            InputError: as `load_descriptors`.
        """
        return np.asarray(load_descriptors(self.path)[list(self.rows)], np.float64)

    def digest(self) -> bytes:
        """A hash of the rows."""
        return hashlib.sha256(np.ascontiguousarray(self.read()).tobytes()).digest()


@dataclass(frozen=True)
class SectionTask:
    """A section that is learned and recognised by one network: which images, and how.

    Attributes:
        dataset: Name of the dataset.
        section: Its number, from 1.
        network: Name of a preset, or `DESCRIPTORS`.
        seed: Of start weights and spikes.
        inputs: The places in each reference traverse, then their queries in the same order: images, or descriptors.
        epochs: Times that every image is shown; None: as often as the preset says.
    """

    dataset: str
    section: int
    network: str
    seed: int
    inputs: tuple[Taken, ...] | tuple[DescriptorRows, ...]
    epochs: int | None = None

    @property
    def config(self) -> Config:
        """The settings of its network, or those of the default preset, of which descriptors take none."""
        config = preset("loihi" if self.network == DESCRIPTORS else self.network)
        epochs = config.learning.epochs if self.epochs is None else self.epochs
        return replace(config, seed=self.seed, learning=replace(config.learning, epochs=epochs))

    @property
    def in_words(self) -> str:
        """What it is, for a progress bar."""
        return f"{self.dataset}, section {self.section}, {self.network}"


class Section(NamedTuple):
    """A task with all that it needs in memory, for a process that sees no files.

    Attributes:
        task: The task.
        inputs: Its inputs: encoded traverses, or descriptors, float64 (n, dimensions).
    """

    task: SectionTask
    inputs: tuple[Any, ...]


class MethodFigures(NamedTuple):
    """A method on a section, fractions in 0..1.

    Attributes:
        released: R@100P as the paper's released code counts it (`evaluate`, ``pr="vprsnn"``).
        recall_at_100_precision: R@100P counted exactly, every query among all.
        recall_at_1: R@1.
        auc: Area under the exact precision-recall curve.
    """

    released: float
    recall_at_100_precision: float
    recall_at_1: float
    auc: float


def kept_in(folder: Path | None) -> FigureCache[SectionTask, dict[str, MethodFigures]]:
    """Figures of finished sections, in a folder; None: they are not kept."""
    digests: dict[Taken | DescriptorRows, bytes] = {}

    def name(task: SectionTask) -> str:
        return f"{task.dataset}-{task.network}-{task.section:02d}-seed-{task.seed}"

    def key(task: SectionTask) -> str:
        digests.update({part: part.digest() for part in task.inputs if part not in digests})
        matchers = [method.matcher for method in of_network(task.network)]
        return content_key(measure, [matchers, to_dict(task.config)], *(digests[part] for part in task.inputs))

    return FigureCache(folder, name, key, _figures)


def _figures(values: Any) -> dict[str, MethodFigures]:
    """Figures as they were kept.

    Raises:
        ValueError, TypeError, AttributeError: they are none.
    """
    found = {str(name): MethodFigures(*map(float, row)) for name, row in values.items()}
    if not all(0.0 <= value <= 1.0 for row in found.values() for value in row):
        raise ValueError("no figures")
    return found


def read(task: SectionTask) -> Section:
    """A task with its images, encoded as its network sees them, or its descriptors.

    Raises:
        LavaVprError: images or descriptors that cannot be used.
    """
    return Section(task, tuple(part.read(task.config) for part in task.inputs))


def measure(section: Section) -> dict[str, MethodFigures]:
    """The figures of every method of a task's network on its section, by the method's name.

    Query i shows place i and no other is right.

    Raises:
        LavaVprError: images or descriptors that cannot be used.
    """
    network = section.task.network
    scores = _of_descriptors(section) if network == DESCRIPTORS else _of_network(section)
    return {method.name: judged(method.matcher, scores[method.matcher]) for method in of_network(network)}


def judged(matcher: str, scores: Scores) -> MethodFigures:
    """The figures of a matcher's scores (places, places), by both rules."""
    truth, sure = np.eye(len(scores), dtype=np.bool_), confidence(matcher, scores)
    exact, released = (evaluate(scores, sure, truth, pr=rule) for rule in ("exact", "vprsnn"))
    return MethodFigures(released.recall_at_100_precision, exact.recall_at_100_precision, exact.recall_at_1, exact.auc)


def _of_descriptors(section: Section) -> dict[str, Scores]:
    """Scores of the descriptors of another program."""
    references, queries = section.inputs
    return {"descriptors": cosine_similarities(references, queries, np.arange(len(references)) % len(queries))}


def _of_network(section: Section) -> dict[str, Scores]:
    """Scores of a network's decoders, and of the baselines that come with it."""
    *references, queries = section.inputs
    wanted = {method.matcher for method in of_network(section.task.network)}
    rivals = tuple(name for name in BASELINES if name in wanted)
    model = train(references, section.task.config)
    found = recognise(model, queries, np.eye(model.places, dtype=np.bool_), Comparison(rivals=rivals))
    own = {name: decode(model, found.counts, name) for name in wanted - set(rivals)}
    return {**own, **{name: found.scores[name] for name in rivals}}
