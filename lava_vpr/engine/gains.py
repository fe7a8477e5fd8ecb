"""Gains: which inputs survive the season, learned from a robot's own sure answers.

A place looks different at each visit, and some inputs change more than others: an input's rate at a learned place
predicts its rate there today more or less well. One gain per input, shared by all places, follows the correlation of
the two over accepted answers, without labels::

    g_i = max(0, correlation of R_i with q_i)        R: rates of the matched reference minus the mean of all references
                                                     q: rates of the query minus the running mean of the previous ones
    starts as if `PRIOR` images had agreed; in units of 1 / `FULL`

Each query is answered before it teaches. Gains change once an epoch, a fixed number of accepted answers; within an
epoch queries do not depend on each other's answers. Sums are whole numbers and decay by a bit shift.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.adaptation import unseen
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import RATE_UNIT, subtracting

GAIN_BITS = 4
FULL = (1 << GAIN_BITS) - 1
"""The largest gain, that of an input which does not change between visits."""
DIGIT_BITS, _DIGITS = 12, 2
"""Bits of a digit of activity, of which a number of single precision has two."""
PRIOR = 10
"""Images at which every input is taken to have agreed before anything is learned."""
EPOCH = 20
"""Accepted answers after which gains are computed again."""
FORGETTING = 9
"""Sums lose 2^-9 of their value with each accepted answer: a time constant of 512."""
MARGINS = 255
"""Number of answers whose confidence is kept; an answer teaches if its confidence is at least their median."""
RECENT, ENOUGH = 30, 10
"""An answer teaches only if at least `ENOUGH` of the last `RECENT` answers were sure."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Statistics of the inputs over the references of a map, encoded as queries.

    Attributes:
        mean: Mean rate of each input, int64 (inputs,), rounded.
        variance: Variance of each input's rate, int64 (inputs,), at least 1.
    """

    mean: NDArray[np.int64]
    variance: NDArray[np.int64]

    @classmethod
    def of(cls, blocks: Iterable[NDArray[np.uint16]]) -> Reference:
        """The statistics of at least one reference, from ``blocks`` of rates (n, inputs)."""
        images, total, squares = 0, np.int64(0), np.int64(0)
        for rates in blocks:
            wide = rates.astype(np.int64)
            images, total, squares = images + len(wide), total + wide.sum(axis=0), squares + (wide * wide).sum(axis=0)
        mean = np.asarray((2 * total + images) // (2 * images))
        return cls(mean, np.maximum((squares - 2 * mean * total + images * mean * mean) // images, 1))


@dataclass(frozen=True, eq=False)
class Season:
    """What was learned of a season, with the queries' running mean; methods return a new state.

    Attributes:
        gains: The current gains, uint8 (inputs,), at most `FULL`.
        sums: Decaying sums of R^2, q^2 and R q over the answers that taught, int64 (3, inputs).
        mean: Running mean of the queries' rates, and of the share that the references' mean still has in it, float64
            (inputs + 1,).
        margins: Confidence of the last answers, oldest first, float64 (at most `MARGINS`,).
        sure: Whether the last of them were sure, uint8 (at most `RECENT`,).
        inputs_of: Which inputs these are: a hash of the settings that make them.
        answered: Answers so far.
        taught: Answers that taught.
    """

    gains: NDArray[np.uint8] = field(repr=False)
    sums: NDArray[np.int64] = field(repr=False)
    mean: NDArray[np.float64] = field(repr=False)
    margins: NDArray[np.float64] = field(repr=False)
    sure: NDArray[np.uint8] = field(repr=False)
    inputs_of: str = ""
    answered: int = 0
    taught: int = 0

    @classmethod
    def start(cls, inputs: int, inputs_of: str = "") -> Season:
        """The state of ``inputs`` inputs before anything is learned."""
        zeros = np.zeros((3, inputs), np.int64)
        return cls(
            np.full(inputs, FULL, np.uint8), zeros, unseen(inputs), np.zeros(0), np.zeros(0, np.uint8), inputs_of
        )

    @property
    def left(self) -> int:
        """How many more answers must teach until gains are made again, at least 1."""
        return EPOCH - self.taught % EPOCH

    @property
    def usual(self) -> bool:
        """Whether the last answer's confidence was at least the median."""
        return bool(self.margins[-1] >= np.sort(self.margins)[len(self.margins) // 2])

    @property
    def steady(self) -> bool:
        """Whether enough of the last answers were sure; off the map, few are."""
        return int(self.sure.sum()) >= ENOUGH

    def after(self, confidence: float, sure: bool) -> Season:
        """The state after an answer with this confidence, -inf where nothing matched."""
        margins = np.append(self.margins, max(confidence, -1.0))[-MARGINS:]
        last = np.append(self.sure, np.uint8(sure))[-RECENT:]
        return replace(self, margins=margins, sure=last, answered=self.answered + 1)

    def learned(self, matched: NDArray[np.int64], query: NDArray[np.int64], variance: NDArray[np.int64]) -> Season:
        """The state after one more answer that teaches.

        Args:
            matched: Rates of the matched reference minus the references' mean, int64 (inputs,).
            query: Rates of the query minus the queries' mean, int64 (inputs,).
            variance: `Reference.variance`.
        """
        products = np.stack([matched * matched, query * query, matched * query])
        season = replace(self, sums=self.sums - (self.sums >> FORGETTING) + products, taught=self.taught + 1)
        return season if season.taught % EPOCH else replace(season, gains=gains_of(season.sums, variance))


def gains_of(sums: NDArray[np.int64], variance: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Gains uint8 (inputs,) that follow from `Season.sums` and `Reference.variance`."""
    own, query, both = (sums + PRIOR * variance).astype(np.float64)
    return np.minimum(np.rint(FULL * np.maximum(both, 0.0) / np.sqrt(own * query)), FULL).astype(np.uint8)


def learned_under(learned: NDArray[np.float32], gains: NDArray[np.uint8]) -> NDArray[np.float32]:
    """What was learned of each input, float32 (inputs, neurons), times its gain, uint8 (inputs,)."""
    return learned * (gains[:, None] / np.float32(FULL))


class Digits(NamedTuple):
    """Activity in whole numbers, which a chip can multiply by gains: mantissas in digits, highest first, and exponents.

    Attributes:
        digits: Of each activity, in units of 2^``exponents``: uint16 (n, digits, inputs), of `DIGIT_BITS` bits.
        exponents: int32 (n, inputs); the host keeps them.
    """

    digits: NDArray[np.uint16]
    exponents: NDArray[np.int32]

    def activity(self, gained: NDArray[np.int64]) -> NDArray[np.float32]:
        """Activity float32 (n, inputs) of which ``gained`` (n, digits, inputs) are the products with gains: what
        single precision makes of activity times gain."""
        places = np.arange(gained.shape[1])[::-1, None] * DIGIT_BITS
        whole = (gained << places).sum(axis=1)  # up to 28 bits
        return np.ldexp(whole.astype(np.float64), self.exponents).astype(np.float32)


def digits_of(activity: NDArray[np.float32]) -> Digits:
    """Activity float32 (n, inputs), at least 0, in digits: one if all are whole and small, as spikes of cells are."""
    if (activity < 1 << DIGIT_BITS).all() and (activity == np.floor(activity)).all():
        return Digits(activity.astype(np.uint16)[:, None], np.zeros(activity.shape, np.int32))
    mantissas, exponents = np.frexp(activity)
    whole = np.ldexp(mantissas.astype(np.float64), _DIGITS * DIGIT_BITS).astype(np.int64)
    places = np.arange(_DIGITS)[::-1, None] * DIGIT_BITS
    digits = (whole[:, None] >> places & (1 << DIGIT_BITS) - 1).astype(np.uint16)
    return Digits(digits, (exponents - _DIGITS * DIGIT_BITS).astype(np.int32))


def weighed(rates: NDArray[np.uint16], gains: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Rates (n, inputs) times ``gains``, each row scaled to its former sum; zeros where all gains are 0."""
    under = rates.astype(np.int64) * gains
    total, kept = rates.sum(axis=1, dtype=np.int64), under.sum(axis=1)
    share = np.divide(total, kept, out=np.zeros(len(rates)), where=kept > 0)
    return np.minimum(np.rint(under * share[:, None]), 65535).astype(np.uint16)


def expected(means: NDArray[np.float64], reference: Reference) -> NDArray[np.int64]:
    """Rates int64 (n, inputs) that queries are expected to have by `Adaptation.means`, rounded."""
    return np.rint(means[:, :-1] + means[:, -1:] * reference.mean).astype(np.int64)


def biases_under(
    network: FixedNetwork, means: NDArray[np.float64], reference: Reference, gains: NDArray[np.uint8]
) -> NDArray[np.int32]:
    """Biases int32 (n, neurons) that subtract the drive of ``means`` (`Adaptation.means`) under ``gains``."""
    shown = expected(means, reference).astype(np.uint16)
    return subtracting(network, network.drives(weighed(shown, gains)) / RATE_UNIT)
