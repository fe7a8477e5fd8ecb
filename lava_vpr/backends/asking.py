"""How queries are asked: in how many views each is presented, and whether the network adapts to those before.

Here, too, models are opened to be asked, from a file or a deployed bundle, with the calibration of their answers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr import model as model_file
from lava_vpr.backends.interface import Presentations, query_presentations
from lava_vpr.backends.replaying import Replayer
from lava_vpr.backends.teaching import Learner
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import LifNetwork
from lava_vpr.encoding import EncodedTraverse, Framing
from lava_vpr.engine.adaptation import Adaptation, Motion, RunningMean
from lava_vpr.engine.gains import Season
from lava_vpr.engine.random import image_keys
from lava_vpr.errors import ConfigError
from lava_vpr.framing import NO_CROP, OfQueries, check_crop
from lava_vpr.inputs.doubts import Sign
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.inputs.views import View, ViewsConfig
from lava_vpr.matching.answers import Answers, Together
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.matching.probability import Calibration
from lava_vpr.model import IntegerModel, Model, as_integer, integer_model
from lava_vpr.season.file import check_season
from lava_vpr.season.table import GainTable, Used

MODELS, OFF = "model", "off"
"""In place of a time constant: that of the model's settings, for who tracks a robot; and none."""


@dataclass(frozen=True)
class Asking:
    """How the queries of a traverse are asked.

    Attributes:
        views: Sideways views in which each query is presented, odd; its spike counts are their sum.
        adapt: Time constant in queries by which neurons' biases follow the queries before; None: they do not.
        tracked_adapt: Who tracks a robot, or learns, adapts as the model's settings say (`tracking`), whatever
            ``adapt`` is.
        crop: ``auto``: bars at the edges of queries are cropped or masked (`lava_vpr.framing`); or ``none``.
        learn: Whether gains of inputs follow from sure answers.
        season: What was learned before; None: nothing.
        replay: What the queries are presented with, gains and biases, in place of all that follows from queries or
            answers before; None: nothing is known of them.
        written: Whether what they are presented with is written, to be replayed.
    """

    views: int = 1
    adapt: float | None = None
    tracked_adapt: bool = False
    crop: str = NO_CROP
    learn: bool = False
    season: Season | None = None
    replay: GainTable | None = None
    written: bool = False

    @classmethod
    def wanted(cls, views: int = 1, adapt: float | str | None = MODELS, crop: str = NO_CROP) -> Asking:
        """As a user wants it, for whom ``adapt`` may also be `MODELS`, or `OFF`, as None."""
        return cls(views, None if isinstance(adapt, str) else adapt, tracked_adapt=adapt == MODELS, crop=crop)

    def tracking(self, model: Model, motion: str) -> Asking:
        """How queries are asked of ``model`` while a robot moves by ``motion``; without a motion each stands alone,
        but where they teach."""
        network, alone = model.config.network, motion == NONE and not self.learn
        if not self.tracked_adapt or alone or not isinstance(network, LifNetwork) or not network.signed:
            return self
        return replace(self, adapt=network.adapt or (LifNetwork.adapt if self.learn else None))

    @property
    def gained(self) -> bool:
        """Whether inputs have gains, or may get some."""
        return self.learn or self.season is not None or self.replay is not None

    def check(self, model: Model) -> None:
        """Refuse what ``model`` cannot be asked.

        Raises:
            ConfigError: an even number of views, or several of vectors; a time constant below 1; adaptation of a
                network without biases; learning without adaptation; a season of other inputs; to replay what another
                network was presented with; to crop what has no edges.
        """
        _ = self.of(model)
        check_crop(self.crop, model.config.encoder)
        if self.views > 1 and INPUTS[model.config.encoder.kind].sees == "vector":
            raise ConfigError(f"--query-views is {self.views}, but the model learned vectors, which have one view")
        given = {"--season": self.season, "--replay": self.replay, "--adapt": self.adapt}
        wanted = {"--learn": self.learn, **{name: value is not None for name, value in given.items()}}
        option = next((name for name, given in wanted.items() if given), None)
        if option is None:
            return
        integer = integer_model(model, option)
        if model.config.encoder.direct is not None:
            self._check_heard(integer)
        if self.season is not None:
            check_season(self.season, integer)
        if self.replay is not None:
            self.replay.check(integer)
        if self.learn and self.adapt is None and not self.tracked_adapt:
            raise ConfigError(
                "--learn needs adaptation, as it learns from what queries before did not show; give --adapt N"
            )
        if self.adapt is not None and not self.adapt >= 1:
            raise ConfigError(f"--adapt is {self.adapt:g}, but must be at least 1 query; give a longer time constant")
        if not integer.network.signed:
            raise ConfigError(
                f"{option} needs neurons with biases, which signed weights have; train with network.signed"
            )

    def _check_heard(self, model: IntegerModel) -> None:
        """Refuse what ``model``, whose neurons hear the cells of a front end themselves, cannot be asked: gains are in
        its weights."""
        if self.replay is not None or self.written:
            raise ConfigError(
                f"{'--gains' if self.written else '--replay'} needs rates of inputs, but these neurons hear the cells "
                "of the front end themselves; write a map with the gains in its weights: lava-vpr season MODEL FILE "
                "--apply MAP"
            )
        if self.gained and model.learned.size == 0:
            raise ConfigError(
                "a bundle keeps no float weights to multiply by gains, and these neurons hear the cells of the front "
                "end themselves; use the model file that was deployed"
            )

    def check_length(self, queries: int) -> None:
        """Refuse more ``queries`` than are known where they are replayed.

        Raises:
            InputError: there are fewer.
        """
        if self.replay is not None:
            self.replay.check_length(queries)

    def check_together(self, together: Together) -> None:
        """Refuse answers that are to teach, but have no probabilities.

        Raises:
            ConfigError: matched like this, they have none.
        """
        if self.learn and together.unknown is not None:
            raise ConfigError(f"--learn needs probabilities, but {together.unknown}")

    def of(self, model: Model) -> tuple[View, ...]:
        """The views in which queries of ``model`` are presented, the straight one first, spaced as its references'."""
        return ViewsConfig(shifts=self.views, shift=model.config.views.shift).views

    def framing(self, model: Model) -> Framing | None:
        """What takes the queries of ``model`` out of their bars, one drive's in order; None: they are left alone."""
        return None if self.crop == NO_CROP else OfQueries(model.activity, model.config.encoder)


PLAINLY = Asking()
"""Each query presented once, the network's own biases."""


class Asker:
    """Presentations of the queries of one traverse, some after some, in order.

    Args:
        model: A trained model.
        asking: How queries are asked, checked.
        seed: The seed of the queries' noise; None: the model's.
    Attributes:
        asking: How they are asked.
        learner: Knows the season; None: all inputs count alike.
    """

    def __init__(self, model: Model, asking: Asking = PLAINLY, seed: int | None = None) -> None:
        self._model, self._seed, self.asking = model, seed, asking
        self._adaptation, self.learner, self._replayer = None, None, None
        if asking.replay is not None:
            self._replayer = Replayer(integer_model(model, "--replay"), asking.replay)
        elif asking.gained:
            self.learner = Learner(integer_model(model, "--learn"), asking.season, asking.adapt)
        elif asking.adapt is not None:
            self._adaptation = Adaptation(integer_model(model, "--adapt").network, asking.adapt)

    @property
    def model(self) -> Model:
        """The model that the last `presentations` are for: the one that is asked, or its weights under gains."""
        return self._model if self.learner is None else self.learner.model

    @property
    def season(self) -> Season | None:
        """What is known of the season; None: all inputs count alike."""
        return None if self.learner is None else self.learner.season

    def in_turn(self, batches: Iterable[Sequence[EncodedTraverse]]) -> Iterator[tuple[EncodedTraverse, Presentations]]:
        """Batch after batch of queries and their `presentations`; where they teach, as many at a time as cannot change
        the gains before the last of them is answered."""
        for views in batches:
            start, end = 0, len(views[0])
            while start < end:
                most = self.learner.season.left if self.learner is not None and self.asking.learn else end
                some = [view.take(slice(start, start + most)) for view in views]
                yield some[0], self.presentations(some)
                start += most

    def presentations(self, views: Sequence[EncodedTraverse]) -> Presentations:
        """Presentations of the next queries, given in each of their views: view after view.

        Raises:
            InputError: the queries were encoded with other settings.
        """
        shown = [query_presentations(self._model, queries, self._seed) for queries in views]
        if (weigher := self.learner or self._replayer) is not None:
            shown = weigher.weighed(shown, views)
        elif self._adaptation is not None:
            bias = self._adaptation.biases(shown[0].rates)
            shown = [replace(part, bias=bias) for part in shown]
        return Presentations.joined(shown)

    def used(self, shown: Presentations, queries: int) -> Used | None:
        """What so many ``queries`` of the last `presentations` are ``shown`` with; None where inputs have no gains, or
        these are replayed, or in the weights."""
        if self.learner is None or shown.bias is None or self.learner.model.network.direct:
            return None
        return Used(self.learner.season.gains, shown.bias[:queries], image_keys(shown.seen[:queries]))

    def learn(self, answers: Answers, signs: Sequence[Sign]) -> NDArray[np.bool_]:
        """Let the answers to the queries of the last `presentations` teach, if they shall; which did, bool (n,).

        Args:
            answers: The n answers.
            signs: Signs of doubt of each query: doubtful ones teach nothing.
        """
        if self.learner is None or not self.asking.learn:
            return np.zeros(len(answers.matches), np.bool_)
        return self.learner.learn(answers, np.array([sign.doubtful for sign in signs]))


def summed(counts: NDArray[np.int32], views: int) -> NDArray[np.int32]:
    """Spike counts (n, neurons) of queries from those of their presentations, view after view, (views n, neurons)."""
    return counts if views == 1 else counts.reshape(views, -1, counts.shape[1]).sum(axis=0, dtype=np.int32)


def adapted_scores(
    scores: NDArray[np.float64], start: NDArray[np.float64], rates: NDArray[np.uint16], tau: float
) -> NDArray[np.float64]:
    """Scores of a baseline, adapted as neurons are: less their running mean over the queries before.

    Args:
        scores: float64 (n, places), the queries of one traverse in order.
        start: The means before the first query, float64 (places,): those of the references' scores.
        rates: Rates of the queries, which tell whether the camera has moved, uint16 (n, inputs).
        tau: Time constant in queries.
    """
    adapted = scores - RunningMean(start, tau).before(scores, Motion().moving(rates))
    return adapted - adapted.min(initial=0.0) + 1.0  # a score of 0 would be no match


def open_model(path: str | Path) -> Model:
    """The model in a file, or in the folder of a deployed bundle.

    Args:
        path: A model file, or a bundle's folder.
    Raises:
        ModelFileError: it cannot be used.
    """
    if not Path(path).is_dir():
        return model_file.load(path)
    from lava_vpr.deploy.bundle.targets import open_bundle  # only those who have a bundle wait for it

    return open_bundle(Path(path))


def calibration_of(model: Model, pool: Pool = ONE_THREAD) -> Calibration | None:
    """The calibration of ``model``: what it holds, or measured now; None for the float conductance model.

    Args:
        model: A model, of any origin.
        pool: Who measures; it does not change the result.
    """
    integer = as_integer(model)
    if model.calibration is not None or integer is None:
        return None if model.calibration is None else Calibration(model.calibration)
    from lava_vpr.training.measuring import measured  # a model that holds it, as its file does, need not wait for it

    return measured(integer, pool)
