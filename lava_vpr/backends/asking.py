"""How queries are asked: in how many views each is presented, and whether the network adapts to those before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import Presentations, query_presentations
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.adaptation import Adaptation, Motion, RunningMean
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.inputs.views import View, ViewsConfig
from lava_vpr.model import Model, integer_model


@dataclass(frozen=True)
class Asking:
    """How the queries of a traverse are asked.

    Attributes:
        views: Sideways views in which each query is presented, odd; its spike counts are their sum.
        adapt: Time constant in queries by which neurons' biases follow the queries before; None: they do not.
    """

    views: int = 1
    adapt: float | None = None

    def check(self, model: Model) -> None:
        """Refuse what ``model`` cannot be asked.

        Raises:
            ConfigError: an even number of views, or several of vectors; a time constant below 1; adaptation of a
                network without biases.
        """
        _ = self.of(model)
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
