"""A task of the paper's table, one section by one network: the places of a dataset and their queries, an image each,
from the official folders or from plain traverses; what a task needs is read here, and measured by any process."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.rivals import BASELINES
from lava_vpr.config import Config, EncoderConfig, preset
from lava_vpr.configfile import to_dict
from lava_vpr.datasets.layouts import DATASETS, Dataset, check_lengths, find_layout
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
from lava_vpr.training.preparing import choose_places
from lava_vpr.traverse import Traverse, located, open_traverse
from lava_vpr.vectors.files import load_descriptors

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


def _figures(task: SectionTask, values: Any) -> Figures:
    """The figures of a task as they were kept: numbers, of all methods of its network and of no others.

    Raises:
        ValueError, TypeError, KeyError, AttributeError: they are none.
    """
    found = {method.name: {key: values[method.name][key] for key in FIGURES} for method in of_network(task.network)}
    numbers = [value for row in found.values() for value in row.values()]
    if found != values or not all(type(number) in (int, float) and 0 <= number <= 1 for number in numbers):
        raise ValueError("no figures")
    return {name: {key: float(value) for key, value in row.items()} for name, row in found.items()}


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


@dataclass(frozen=True)
class Source:
    """A dataset that is at hand.

    Attributes:
        dataset: Its row.
        learned: What its reference traverses are called.
        recognised: What its query traverse is called.
        official: Whether the paper's traverses were found in the official folders.
        traverses: The places in each traverse, an image each, references first, the query last.
        images: Images of each whole traverse.
    """

    dataset: Dataset
    learned: tuple[str, ...]
    recognised: str
    official: bool
    traverses: tuple[Traverse, ...] = field(repr=False)
    images: tuple[int, ...]

    @property
    def places(self) -> int:
        """The places of each traverse."""
        return len(self.traverses[0])

    @property
    def sections(self) -> int:
        """The paper's sections that the places are enough for."""
        return min(self.dataset.sections, self.places // self.dataset.places)

    @property
    def task(self) -> str:
        """What is learned and recognised, in words."""
        return f"{' and '.join(self.learned)} learned, {self.recognised} recognised"

    def images_of(self, section: int) -> tuple[Traverse, ...]:
        """The images of a section in each traverse."""
        return tuple(traverse.take(range(*self.dataset.section(section))) for traverse in self.traverses)


def official(name: str, root: Path, positions: Sequence[Path] = ()) -> Source:
    """Dataset ``name`` in its official folders below ``root``.

    Args:
        name: Name of a row in `DATASETS`.
        root: The folder that holds it.
        positions: Positions of each traverse, references first, the query last; none where order tells.
    Raises:
        InputError: it does not lie there, images correspond but are unequally many, positions are missing or of no
            use, or the places are fewer than a section's.
    """
    opened = find_layout(name, root)
    layout, row = opened.layout, opened.dataset
    whole = [open_traverse(path, every=layout.every) for path in (*opened.references, opened.query)]
    check_lengths(opened, whole)
    if layout.ground_truth == "frames" and positions:
        raise InputError(f"{name}: image k of each traverse shows the same place; leave out --positions {name}=...")
    if layout.ground_truth == "positions" and not positions:
        files = ",".join(f"{kind}.csv" for kind in (*row.learned, row.recognised))
        raise InputError(
            f"{shown(root)}: only positions tell which images of {row.title} show the same place; give --positions "
            f"{name}={files}"
        )
    sampled = [opened.sampled(traverse) for traverse in whole]
    chosen = _matched(sampled, whole, positions, layout.spacing)
    return _checked(Source(row, row.learned, row.recognised, True, chosen, tuple(map(len, whole))))


def stand_in(name: str, paths: Sequence[Path], positions: Sequence[Path] = ()) -> Source:
    """Plain traverses in place of dataset ``name``: every image of the first is a place.

    Args:
        name: Name of a row in `DATASETS`.
        paths: Folder, list or video of each traverse: references, then the query.
        positions: As in `official`; none: image k of each traverse shows the same place.
    Raises:
        InputError: fewer than two traverses, unequally many images without positions, or as `official`.
    """
    if len(paths) < 2:
        raise InputError(
            f"--traverses {name}: names one traverse; give references, then the query, with commas between"
        )
    whole = [open_traverse(path) for path in paths]
    uneven = next((traverse for traverse in whole if len(traverse) != len(whole[0])), None)
    if uneven is not None and not positions:
        raise InputError(
            f"{shown(uneven.source)}: has {len(uneven)} images, {shown(whole[0].source)} has {len(whole[0])}: image k "
            f"must show the same place in each; complete them, or give --positions {name}=..."
        )
    chosen = _matched(whole, whole, positions, None)
    names = tuple(shown(Path(path).stem) for path in paths)
    return _checked(Source(DATASETS[name], names[:-1], names[-1], False, chosen, tuple(map(len, whole))))


def _matched(
    sampled: Sequence[Traverse], whole: Sequence[Traverse], positions: Sequence[Path], spacing: float | None
) -> tuple[Traverse, ...]:
    """The images of each traverse that show the places: those with the same numbers, or the nearest by position."""
    if not positions:
        return tuple(sampled)
    if len(positions) != len(whole):
        raise InputError(
            f"{shown(positions[0])}: is one of {len(positions)} files of positions for {len(whole)} traverses; give "
            "one for each, references first"
        )
    first = located(sampled[0], len(whole[0]), positions[0])
    others = [located(traverse, len(traverse), path) for traverse, path in zip(whole[1:], positions[1:], strict=True)]
    return tuple(choose_places([first, *others], EncoderConfig(), spacing=spacing))


def _checked(source: Source) -> Source:
    """``source``, seen to be enough for a section."""
    if not source.sections:
        raise InputError(
            f"{shown(source.traverses[0].source)}: gives {source.places} places, a section of {source.dataset.title} "
            f"has {source.dataset.places}; complete the images"
        )
    return source


def tasks(
    source: Source,
    network: str,
    sections: Sequence[int],
    seed: int,
    epochs: int | None = None,
    descriptors: tuple[Path, Path] | None = None,
) -> list[SectionTask]:
    """The tasks of a network on a dataset, a section each.

    Args:
        source: The dataset.
        network: Name in `NETWORKS`.
        sections: Their numbers, from 1.
        seed, epochs: As in `SectionTask`.
        descriptors: Files of the references' and the queries' descriptors; None: there are none.
    Raises:
        InputError: descriptors that cannot be used, or that are not one for each image.
    """
    if network != DESCRIPTORS:
        return [SectionTask(source.dataset.name, k, network, seed, source.images_of(k), epochs) for k in sections]
    if descriptors is None:
        return []
    loaded = [(path, load_descriptors(path)) for path in descriptors]
    return [SectionTask(source.dataset.name, k, network, 0, _rows(source, loaded, k)) for k in sections]


def _rows(source: Source, files: Sequence[tuple[Path, NDArray[Any]]], section: int) -> tuple[NDArray[Any], ...]:
    """Descriptors of a section, (n, dimensions): references, traverse after traverse, and queries.

    A file has a row for each place, or one for each image of the whole traverses; of references the traverses follow
    each other.

    Raises:
        InputError: it has neither so many.
    """
    found = []
    last = len(source.traverses) - 1
    for (path, vectors), numbers in zip(files, (range(last), range(last, last + 1)), strict=True):
        rows = len(vectors)
        by_place, by_image = source.places * len(numbers), sum(source.images[k] for k in numbers)
        if rows not in (by_place, by_image):
            whole = f", or {by_image:,} images" if by_image != by_place else ""
            raise InputError(
                f"{shown(path)}: has {rows:,} rows for {by_place:,} places{whole}; give one row for each, the "
                "reference traverses one after another"
            )
        chosen: list[int] = []
        start = 0
        places = np.arange(*source.dataset.section(section))
        for k in numbers:
            one = places if rows == by_place else source.traverses[k].indices[places]
            chosen += (start + one).tolist()
            start += source.places if rows == by_place else source.images[k]
        found.append(vectors[chosen])
    return tuple(found)
