"""How queries are asked: in how many views each is presented, and whether the network adapts to those before.

Here, too, models are opened to be asked, from a file or a deployed bundle, with the calibration of their answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr import model as model_file
from lava_vpr.backends.interface import Presentations, query_presentations
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import LifNetwork
from lava_vpr.encoding import EncodedTraverse, Framing
from lava_vpr.engine.adaptation import Adaptation, Motion, RunningMean
from lava_vpr.errors import ConfigError
from lava_vpr.framing import NO_CROP, OfQueries, check_crop
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.inputs.views import View, ViewsConfig
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.matching.probability import Calibration
from lava_vpr.model import Model, as_integer, integer_model

MODELS, OFF = "model", "off"
"""In place of a time constant: that of the model's settings, for who tracks a robot; and none."""


@dataclass(frozen=True)
class Asking:
    """How the queries of a traverse are asked.

    Attributes:
        views: Sideways views in which each query is presented, odd; its spike counts are their sum.
        adapt: Time constant in queries by which neurons' biases follow the queries before; None: they do not.
        tracked_adapt: Who tracks a robot adapts as the model's settings say (`tracking`), whatever ``adapt`` is.
        crop: ``auto``: bars at the edges of queries are cropped or masked (`lava_vpr.framing`); or ``none``.
    """

    views: int = 1
    adapt: float | None = None
    tracked_adapt: bool = False
    crop: str = NO_CROP

    @classmethod
    def wanted(cls, views: int = 1, adapt: float | str | None = MODELS, crop: str = NO_CROP) -> Asking:
        """As a user wants it, for whom ``adapt`` may also be `MODELS`, or `OFF`, as None."""
        return cls(views, None if isinstance(adapt, str) else adapt, tracked_adapt=adapt == MODELS, crop=crop)

    def tracking(self, model: Model, motion: str) -> Asking:
        """How queries are asked of ``model`` while a robot moves by ``motion``; without a motion each stands alone."""
        network = model.config.network
        if not self.tracked_adapt or motion == NONE or not isinstance(network, LifNetwork) or not network.signed:
            return self
        return replace(self, adapt=network.adapt or None)

    def check(self, model: Model) -> None:
        """Refuse what ``model`` cannot be asked.

        Raises:
            ConfigError: an even number of views, or several of vectors; a time constant below 1; adaptation of a
                network without biases; to crop what has no edges.
        """
        _ = self.of(model)
        check_crop(self.crop, model.config.encoder)
        if self.views > 1 and INPUTS[model.config.encoder.kind].sees == "vector":
            raise ConfigError(f"--query-views is {self.views}, but the model learned vectors, which have one view")
        if self.adapt is None:
            return
        if not self.adapt >= 1:
            raise ConfigError(f"--adapt is {self.adapt:g}, but must be at least 1 query; give a longer time constant")
        if not integer_model(model, "--adapt").network.signed:
            raise ConfigError("--adapt needs neurons with biases, which signed weights have; train with network.signed")

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
    """

    def __init__(self, model: Model, asking: Asking = PLAINLY, seed: int | None = None) -> None:
        self._model, self._seed = model, seed
        self._adaptation = None
        if asking.adapt is not None:
            self._adaptation = Adaptation(integer_model(model, "--adapt").network, asking.adapt)

    def presentations(self, views: Sequence[EncodedTraverse]) -> Presentations:
        """Presentations of the next queries, given in each of their views: view after view.

        Raises:
            InputError: the queries were encoded with other settings.
        """
        shown = [query_presentations(self._model, queries, self._seed) for queries in views]
        if self._adaptation is not None:
            bias = self._adaptation.biases(shown[0].rates)
            shown = [replace(part, bias=bias) for part in shown]
        return Presentations.joined(shown)


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
