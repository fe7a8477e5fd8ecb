"""One section by one network: what it needs is read here, and measured by any process."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.rivals import BASELINES
from lava_vpr.config import Config, preset
from lava_vpr.configfile import to_dict
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse
from lava_vpr.errors import InputError
from lava_vpr.experiments.cache import Cache, content_key
from lava_vpr.matching.baselines import cosine_similarities, load_descriptors
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.matching.matchers import confidence
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


class Rows(NamedTuple):
    """Rows of a file of descriptors.

    Attributes:
        path: The .npy file.
        rows: Which rows, in order.
    """

    path: Path
    rows: tuple[int, ...]

    def read(self) -> NDArray[np.float64]:
        """The rows, float64 (n, dimensions).

        Raises:
            InputError: as `load_descriptors`.
        """
        return np.asarray(load_descriptors(self.path)[list(self.rows)], np.float64)


@dataclass(frozen=True)
class Task:
    """A section that is learned and recognised by one network: which images, and how.

    Attributes:
        dataset: Name of the dataset.
        section: Its number, from 1.
        network: Name of a preset, or `DESCRIPTORS`.
        seed: Of start weights and spikes.
        references: The places, in each reference traverse; empty with `DESCRIPTORS`.
        query: Their queries, in the same order; None with `DESCRIPTORS`.
        descriptors: Rows of the references, traverse after traverse, and of the queries; None without them.
        epochs: Times that every image is shown; None: as often as the preset says.
    """

    dataset: str
    section: int
    network: str
    seed: int
    references: tuple[Taken, ...] = ()
    query: Taken | None = None
    descriptors: tuple[Rows, Rows] | None = None
    epochs: int | None = None

    @property
    def config(self) -> Config:
        """The settings of its network."""
        config = dataclasses.replace(preset(self.network), seed=self.seed)
        if self.epochs is None:
            return config
        return dataclasses.replace(config, learning=dataclasses.replace(config.learning, epochs=self.epochs))

    @property
    def in_words(self) -> str:
        """What it is, for a progress bar."""
        return f"{self.dataset}, section {self.section}, {self.network}"


class Section(NamedTuple):
    """A task with all that it needs in memory, for a process that sees no files.

    Attributes:
        task: The task.
        references: The places, in each reference traverse, as its network sees them; empty with `DESCRIPTORS`.
        query: Their queries, the same way; None with `DESCRIPTORS`.
        descriptors: Of the references, traverse after traverse, and of the queries, float64 (n, dimensions); None
            without them.
    """

    task: Task
    references: tuple[EncodedTraverse, ...] = ()
    query: EncodedTraverse | None = None
    descriptors: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None


class Figures(NamedTuple):
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


def kept_in(folder: Path | None) -> Cache[Task, dict[str, Figures]]:
    """Figures of finished sections, in a folder; None: they are not kept."""
    digests: dict[Taken, bytes] = {}

    def name(task: Task) -> str:
        return f"{task.dataset}-{task.network}-{task.section:02d}-seed-{task.seed}"

    def key(task: Task) -> str:
        decides = {
            "methods": [method.matcher for method in of_network(task.network)],
            "settings": None if task.network == DESCRIPTORS else to_dict(task.config),
        }
        images = [*task.references, *(() if task.query is None else (task.query,))]
        digests.update({taken: _digest(taken) for taken in images if taken not in digests})
        vectors = [np.ascontiguousarray(rows.read()).tobytes() for rows in task.descriptors or ()]
        return content_key(measure, decides, *(digests[taken] for taken in images), *vectors)

    return Cache(folder, name, key, _figures)


def _figures(values: Any) -> dict[str, Figures]:
    """Figures as they were kept.

    Raises:
        ValueError, TypeError, AttributeError: they are none.
    """
    found = {str(name): Figures(*map(float, row)) for name, row in values.items()}
    if not all(0.0 <= value <= 1.0 for row in found.values() for value in row):
        raise ValueError("no figures")
    return found


def _digest(taken: Taken) -> bytes:
    """A hash of images: of their files, and of which frames of a video they are."""
    traverse = taken.open()
    frames = [] if traverse.frames is None else traverse.frames.tolist()
    digest = hashlib.sha256(json.dumps([taken.every, frames]).encode())
    for path in traverse.paths:
        _add(digest, Path(path))
    return digest.digest()


def _add(digest: hashlib._Hash, path: Path) -> None:
    """Add the bytes of a file."""
    try:
        with open_regular(path) as file:
            while block := file.read(1 << 20):
                digest.update(block)
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror}); check the file") from None


def read(task: Task) -> Section:
    """A task with its images, encoded as its network sees them, or its descriptors.

    Raises:
        LavaVprError: images or descriptors that cannot be used.
    """
    if task.descriptors is not None:
        references, queries = (rows.read() for rows in task.descriptors)
        return Section(task, descriptors=(references, queries))
    config = task.config
    query = None if task.query is None else _encoded(task.query, config)
    return Section(task, tuple(_encoded(taken, config) for taken in task.references), query)


def measure(section: Section) -> dict[str, Figures]:
    """The figures of every method of a task's network on its section, by the method's name.

    Query i shows place i and no other is right.

    Raises:
        LavaVprError: images or descriptors that cannot be used.
    """
    network = section.task.network
    scores = _of_descriptors(section) if network == DESCRIPTORS else _of_network(section)
    return {method.name: judged(method.matcher, scores[method.matcher]) for method in of_network(network)}


def judged(matcher: str, scores: Scores) -> Figures:
    """The figures of a matcher's scores (places, places), by both rules."""
    truth, sure = np.eye(len(scores), dtype=np.bool_), confidence(matcher, scores)
    exact, released = (evaluate(scores, sure, truth, pr=rule) for rule in ("exact", "vprsnn"))
    return Figures(released.recall_at_100_precision, exact.recall_at_100_precision, exact.recall_at_1, exact.auc)


def _of_descriptors(section: Section) -> dict[str, Scores]:
    """Scores of the descriptors of another program."""
    task = section.task
    if section.descriptors is None:
        raise InputError(f"{task.in_words}: there are no descriptors; give --descriptors {task.dataset}=REF,QUERY")
    references, queries = section.descriptors
    labels = np.arange(len(references)) % len(queries)
    return {"descriptors": cosine_similarities(references, queries, labels)}


def _of_network(section: Section) -> dict[str, Scores]:
    """Scores of a network's decoders, and of the baselines that come with it."""
    config, references = section.task.config, list(section.references)
    wanted = {method.matcher for method in of_network(section.task.network)}
    rivals = tuple(name for name in BASELINES if name in wanted)
    queries = references[0] if section.query is None else section.query
    model = train(references, config)
    found = recognise(model, queries, np.eye(model.places, dtype=np.bool_), Comparison(rivals=rivals))
    own = {name: decode(model, found.counts, name) for name in wanted - set(rivals)}
    return {**own, **{name: found.scores[name] for name in rivals}}


def _encoded(taken: Taken, config: Config) -> EncodedTraverse:
    """Images as the network sees them, with what baselines compare."""
    return encode_traverse(taken.open(), config.encoder, Keep.ALL)
