"""A task of the paper's table, one section by one network: what it needs is read here, and measured by any process."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.rivals import BASELINES
from lava_vpr.config import Config, preset
from lava_vpr.configfile import to_dict
from lava_vpr.encoding import Keep, encode_traverse
from lava_vpr.errors import InputError, shown
from lava_vpr.experiments.cache import FigureCache, content_key
from lava_vpr.experiments.grid import Figures
from lava_vpr.experiments.task import judged_scores
from lava_vpr.matching.baselines import cosine_similarities
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.model import decode
from lava_vpr.paper_table.methods import DESCRIPTORS, of_network
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.storage.reading import open_regular
from lava_vpr.training.loop import train
from lava_vpr.traverse import Traverse

FIGURES = ("released", "recall_at_100_precision", "recall_at_1", "auc")
"""The figures of a method on a section, fractions in 0..1: R@100P as the paper's released code counts it (`evaluate`,
``pr="vprsnn"``) and exactly, every query among all; R@1; area under the exact precision-recall curve."""


def digest(part: Traverse | NDArray[Any]) -> bytes:
    """A hash of the files of images, and of which frames of a video they are; of descriptors, of their values.

    Raises:
        InputError: a file cannot be read.
    """
    if not isinstance(part, Traverse):
        return hashlib.sha256(np.ascontiguousarray(part, np.float64).tobytes()).digest()
    hashed = hashlib.sha256(json.dumps([] if part.frames is None else part.frames.tolist()).encode())
    for path in map(Path, part.paths):
        try:
            with open_regular(path) as file:
                while block := file.read(1 << 20):
                    hashed.update(block)
        except OSError as error:
            raise InputError(f"{shown(path)}: cannot be read ({error.strerror}); check the file") from None
    return hashed.digest()


@dataclass(frozen=True)
class SectionTask:
    """A section that is learned and recognised by one network: which images, and how.

    Attributes:
        dataset: Name of the dataset.
        section: Its number, from 1.
        network: Name of a preset, or `DESCRIPTORS`.
        seed: Of start weights and spikes.
        inputs: The places in each reference traverse, then their queries in the same order: traverses, encoded once
            they were `read`; or descriptors (n, dimensions).
        epochs: Times that every image is shown; None: as often as the preset says.
    """

    dataset: str
    section: int
    network: str
    seed: int
    inputs: tuple[Any, ...] = field(repr=False, compare=False)
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


def kept_in(folder: Path) -> FigureCache[SectionTask, Figures]:
    """Figures of finished sections, in a folder."""
    digests: dict[tuple[str, int, bool], list[bytes]] = {}

    def name(task: SectionTask) -> str:
        return f"{task.dataset}-{task.network}-{task.section:02d}-seed-{task.seed}"

    def key(task: SectionTask) -> str:
        images = task.dataset, task.section, task.network == DESCRIPTORS
        if images not in digests:
            digests[images] = [digest(part) for part in task.inputs]
        matchers = [method.matcher for method in of_network(task.network)]
        return content_key(measure, [matchers, to_dict(task.config)], *digests[images])

    return FigureCache(folder, name, key, _figures)


def _figures(values: Any) -> Figures:
    """Figures as they were kept.

    Raises:
        ValueError, TypeError, KeyError, AttributeError: they are none.
    """
    found = {str(name): {key: float(row[key]) for key in FIGURES} for name, row in values.items()}
    if not all(0.0 <= value <= 1.0 for row in found.values() for value in row.values()):
        raise ValueError("no figures")
    return found


def read(task: SectionTask) -> SectionTask:
    """A task with its images encoded as its network sees them, with what baselines compare; or with its descriptors.

    Raises:
        InputError: an image cannot be read.
    """
    if task.network == DESCRIPTORS:
        return replace(task, inputs=tuple(np.asarray(part, np.float64) for part in task.inputs))
    return replace(task, inputs=tuple(encode_traverse(part, task.config.encoder, Keep.ALL) for part in task.inputs))


def measure(shared: None, task: SectionTask) -> Figures:
    """The figures of every method of a task's network on its section, by the method's name.

    Query i shows place i and no other is right.

    Raises:
        LavaVprError: images or descriptors that cannot be used.
    """
    scores = (_of_descriptors if task.network == DESCRIPTORS else _of_network)(task)
    return {method.name: _judged(method.matcher, scores[method.matcher]) for method in of_network(task.network)}


def _judged(matcher: str, scores: Scores) -> Mapping[str, float]:
    """`FIGURES` of a matcher's scores (places, places)."""
    truth = np.eye(len(scores), dtype=np.bool_)
    released = evaluate(scores, confidence(matcher, scores), truth, pr="vprsnn").recall_at_100_precision
    return {"released": released, **judged_scores(matcher, scores, truth)._asdict()}


def _of_descriptors(task: SectionTask) -> dict[str, Scores]:
    """Scores of the descriptors of another program."""
    references, queries = task.inputs
    return {"descriptors": cosine_similarities(references, queries, np.arange(len(references)) % len(queries))}


def _of_network(task: SectionTask) -> dict[str, Scores]:
    """Scores of a network's decoders, and of the baselines that come with it."""
    *references, queries = task.inputs
    wanted = {method.matcher for method in of_network(task.network)}
    rivals = tuple(name for name in BASELINES if name in wanted)
    model = train(references, task.config)
    found = recognise(model, queries, np.eye(model.places, dtype=np.bool_), Comparison(rivals=rivals))
    own = {name: decode(model, found.counts, name) for name in wanted - set(rivals)}
    return {**own, **{name: found.scores[name] for name in rivals}}
