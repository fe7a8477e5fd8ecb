"""Answers that teach: queries presented under the gains of inputs, which follow from the answers before.

The host computes gains and biases; whatever runs the network is shown rates and biases, and knows of nothing else.
Where neurons hear the cells of a front end themselves, gains are in the weights instead, which are written again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import Presentations
from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.adaptation import Adaptation
from lava_vpr.engine.gains import FULL, Reference, Season, biases_under, expected, learned_under
from lava_vpr.engine.inference.direct import strengths
from lava_vpr.engine.rates import query_rates16
from lava_vpr.matching.answers import Answers
from lava_vpr.model import IntegerModel
from lava_vpr.season.file import unlearned

ALONE, TRACKED = 0.7, 0.95
"""Probability from which on an answer may teach: by its image alone, if it is no less sure than the median of those
before; and by the filter of who tracks a robot."""
_TOGETHER = 256
"""References whose rates are made together."""


class LastQueries(NamedTuple):
    """Queries that were asked last, with what they can teach.

    Attributes:
        rates: Rates without gains (`strengths`), uint16 (n, inputs).
        means: What they differ from, `Adaptation.means`.
        counted: Whether each showed something new, bool (n,).
    """

    rates: NDArray[np.uint16]
    means: NDArray[np.float64]
    counted: NDArray[np.bool_]


class Learner:
    """Gains of the queries of one traverse, some queries after some, in order.

    Args:
        model: The model that answers.
        season: What was learned before; None: nothing.
        adapt: Time constant of adaptation in queries; None: biases follow no queries.
    Attributes:
        season: What is known of the season.
        model: The model as it is presented to: where neurons hear the cells of a front end themselves, its learned
            weights are multiplied by the gains in force and quantised again.
    """

    def __init__(self, model: IntegerModel, season: Season | None, adapt: float | None) -> None:
        self.model, self._plain, self._adapts = model, model, adapt is not None
        self.season = unlearned(model) if season is None else season
        start = self.season.mean if self._adapts else None
        self._adaptation = Adaptation(model.network, math.inf if adapt is None else adapt, start)
        self._weighed_by = np.full(model.config.encoder.inputs, FULL, np.uint8)
        self._reference = reference_of(model)
        self._asked = LastQueries(np.zeros((0, 0), np.uint16), np.zeros((0, 1)), np.zeros(0, np.bool_))

    def weighed(self, shown: Sequence[Presentations], views: Sequence[EncodedTraverse]) -> list[Presentations]:
        """The next queries under the gains in force, in each of their views, of which ``shown`` is without gains."""
        gains, encoder, direct = self.season.gains, self._plain.config.encoder, self._plain.network.direct
        means, counted = self._adaptation.means(shown[0].rates)
        self._asked = LastQueries(strengths(shown[0].rates, direct), means, counted)
        if direct:
            self._weigh_again(gains)
        if direct or (gains == FULL).all():
            bias = self._adaptation.taking_off(means)
            return [replace(part, bias=bias) for part in shown]
        bias = biases_under(self._plain.network, means, self._reference, gains)
        return under_gains(shown, views, gains, bias, encoder)

    def _weigh_again(self, gains: NDArray[np.uint8]) -> None:
        """Let the weights of `model` be those under ``gains``."""
        if np.array_equal(gains, self._weighed_by):
            return
        from lava_vpr.training.loop import integer_network  # only who learns, or knows a season, waits for it

        own = self._plain
        network = integer_network(learned_under(own.learned, gains), own.config, own.stretches, own.activity)
        self.model, self._adaptation.network = replace(own, network=network, bundle=None), network
        self._weighed_by = gains.copy()

    def learn(self, answers: Answers, doubtful: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Let the answers to the last queries teach, not those to ``doubtful`` ones (n,); which did, bool (n,)."""
        season, reference, asked, tracked = self.season, self._reference, self._asked, answers.off_map is not None
        encoder, direct = self._plain.config.encoder, self._plain.network.direct
        sure = (answers.matches >= 0) & (answers.probability >= (TRACKED if tracked else ALONE)) & ~doubtful
        seen, taught = asked.rates - expected(asked.means, reference), np.zeros(len(sure), np.bool_)
        for i, place in enumerate(answers.matches.tolist()):
            season = season.after(float(answers.confidence[i]), bool(sure[i]))
            taught[i] = sure[i] and asked.counted[i] and season.steady and (tracked or season.usual)
            if taught[i]:
                known = strengths(query_rates16(self._plain.activity[place : place + 1], encoder), direct)[0]
                season = season.learned(known - reference.mean, seen[i], reference.variance)
        self.season = replace(season, mean=self._adaptation.mean)
        return taught


def under_gains(
    shown: Sequence[Presentations],
    views: Sequence[EncodedTraverse],
    gains: NDArray[np.uint8],
    bias: NDArray[np.int32],
    encoder: EncoderConfig,
) -> list[Presentations]:
    """Queries under ``gains``, in each of their views, of which ``shown`` is without.

    Args:
        shown: The queries in each of their views, without gains.
        views: The same, encoded.
        gains: One for each input, uint8 (inputs,), or (n, inputs) of each query; where all are `FULL`, rates stay.
        bias: Biases, int32 (n, neurons).
        encoder: Settings of the inputs.
    """
    rows = np.broadcast_to(gains, shown[0].rates.shape)
    lessened = ~(rows == FULL).all(axis=1)
    presented = []
    for part, queries in zip(shown, views, strict=True):
        rates = part.rates.copy()
        rates[lessened] = query_rates16(queries.activity[lessened] * rows[lessened].astype(np.float32), encoder)
        presented.append(replace(part, rates=rates, bias=bias, plain=part.rates))
    return presented


def reference_of(model: IntegerModel) -> Reference:
    """What inputs do over the references of ``model``: the first traverse, straight ahead."""
    first, encoder, direct = model.activity[: model.places], model.config.encoder, model.network.direct
    blocks = (query_rates16(first[k : k + _TOGETHER], encoder) for k in range(0, len(first), _TOGETHER))
    return Reference.of(strengths(rates, direct) for rates in blocks)
