"""A row of results: what is learned, what is asked, and what answers; the one way in which a figure is computed.

The rows, each on its sections with every seed, are a grid of experiments (`lava_vpr.experiments.grid`).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.places import PlacesSection, learn, places
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.rivals import BASELINES
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.presentations import cores
from lava_vpr.experiments.task import Route, modelled
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.matching.decoders import confidence, decode
from lava_vpr.matching.evaluation import Metrics, Recall, evaluate
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, Recognition, recognise

SEEDS = (0, 1, 2)
TAU = 30.0
"""Time constant of adaptation, in queries."""
STANDING = 20
"""Frames that a robot sees of each place where it stands still."""

PRINTED = ", as printed"
"""Behind the name of one of the paper's decoders: as its equations are printed, not as its code was released."""

Figures = dict[str, list[float]]
"""By matcher R@1, R@100P and AUC in percent, ``network`` being the default decoder; ``costs`` are uJ and ms."""


@dataclass(frozen=True)
class ResultRow:
    """What a row of results is computed from; a change of any of it makes it another row.

    Attributes:
        name: Its name in docs/results.json.
        config: Settings; the seed is replaced.
        sections: The sections, one model each.
        matchers: Baselines and decoders that stand beside the default decoder.
        tolerance: Places that an answer may be off.
        sequence: Queries that are matched together.
        adapt: Whether everything is computed adapted to the queries before, too.
        standing: Whether each query is seen `STANDING` times, with a camera's noise on its activity.
        costs: Whether energy and time on Kapoho Bay are modelled, for the first seed.
    """

    name: str
    config: Config
    sections: tuple[PlacesSection, ...]
    matchers: tuple[str, ...] = ()
    tolerance: int = 0
    sequence: int = 1
    adapt: bool = False
    standing: bool = False
    costs: bool = False


def measure(row: ResultRow, section: PlacesSection, seed: int) -> Figures:
    """The figures of one section with one seed.

    Raises:
        InputError: LAVA_VPR_DATA does not name the images.
    """
    model = learn(section, dataclasses.replace(row.config, seed=seed))
    return asked(row, model, section, costs=seed == SEEDS[0])


def asked(row: ResultRow, model: Model, section: PlacesSection, costs: bool = False) -> Figures:
    """The figures of a model of a section."""
    result = _asked(model, row, section)
    found = {"network": _percent(result.metrics[result.default])}
    for name in row.matchers:
        found[name] = _percent(_as_printed(model, result, name) if name.endswith(PRINTED) else result.metrics[name])
    if row.adapt:
        found["network, adapted"] = _percent(result.adapted[result.default])
        found |= {f"{name}, adapted": _percent(result.adapted[name]) for name in row.matchers if name in BASELINES}
    if row.costs and costs:
        found |= _costs(model, section)
    return found


def _as_printed(model: Model, result: Recognition, name: str) -> Metrics:
    """Figures of one of the paper's decoders read as its equations are printed, on the same spikes."""
    name = name.removesuffix(PRINTED)
    scores = decode(name, model.responses, result.counts, variant="printed", gamma=model.config.decoder.gamma)
    return evaluate(scores, confidence(name, scores), result.truth)


def _percent(metrics: Metrics) -> list[float]:
    """What is kept of the figures of a matcher."""
    return [round(100 * value, 4) for value in Recall.of(metrics)]


def _asked(model: Model, row: ResultRow, section: PlacesSection) -> Recognition:
    """What a model makes of the queries of its places."""
    (queries,) = places(section, 1, model.config, ViewsConfig())
    shown = np.repeat(np.arange(len(queries)), STANDING if row.standing else 1)
    truth: NDArray[np.bool_] = np.abs(shown[:, None] - np.arange(len(queries))) <= row.tolerance
    rivals = tuple(name for name in row.matchers if name in BASELINES)
    comparison = Comparison(row.sequence, rivals, None, False, Asking(adapt=TAU if row.adapt else None))
    asked = _standing(queries, section.first) if row.standing else queries
    return recognise(model, asked, truth, comparison, pool=Pool(cores()))


def _standing(queries: EncodedTraverse, seed: int) -> EncodedTraverse:
    """Each query `STANDING` times, with a camera's noise on its activity."""
    order = np.repeat(np.arange(len(queries)), STANDING)
    activity = queries.activity[order]
    noisy = activity * np.random.default_rng(seed).normal(1.0, 0.1, activity.shape).clip(0.5, 1.5)
    return dataclasses.replace(
        queries,
        names=tuple(queries.names[k] for k in order),
        indices=np.arange(len(order)),
        activity=noisy.astype(np.float32),
        patches=None,
        thumbnails=None,
        hog=None,
    )


def _costs(model: Model, section: PlacesSection) -> Figures:
    """Modelled dynamic energy (uJ) and time (ms) of a query on Kapoho Bay: nominal, clearing counted, host I/O not."""
    (queries,) = places(section, 1, model.config, ViewsConfig())
    costs = modelled(model, Route((), queries, np.eye(len(queries), dtype=bool)))
    return {} if costs is None else {"costs": [round(costs.microjoules, 4), round(costs.milliseconds, 5)]}
