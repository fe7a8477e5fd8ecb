"""The literal model of gains: a drive whose answers teach, image by image in plain Python numbers, by the words alone.

Used by engine.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import NamedTuple

FULL, PRIOR, FORGETTING = 15, 10, 512


class Told(NamedTuple):
    """An answer: its place, -1 for none, its probability and confidence, and whether a filter follows the robot."""

    place: int
    probability: float
    confidence: float
    tracked: bool


def single(value: float) -> float:
    """The number of 32 bits next to it, as activities are."""
    return float(struct.unpack("f", struct.pack("f", value))[0])


def rates(activity: list[float], most: int, spikes: float) -> list[int]:
    """The ``most`` largest responses, and those equal to the least of them, share the spikes of a step."""
    least = sorted(activity, reverse=True)[most - 1] if 0 < most < len(activity) else 0.0
    kept = [value if value >= least else 0.0 for value in activity]
    total = math.fsum(kept)
    return [min(round(value / total * (spikes * 65536)), 65535) if total else 0 for value in kept]


@dataclass
class Drive:
    """A robot's drive through a map.

    Attributes:
        weights: Of each input, the weight to each neuron.
        own: Biases of the neurons, in units of v.
        safe: The largest bias.
        references: Activity of each place.
        most, spikes: Inputs of a query, and input spikes a step.
        tau: Time constant of adaptation.
        epoch: Answers that teach until gains are computed again.
        remembered: Answers whose confidence is remembered.
        recent, enough: Of the last answers, how many must be sure.
    """

    weights: list[list[int]]
    own: list[int]
    safe: int
    references: list[list[float]]
    most: int
    spikes: float
    tau: float
    epoch: int
    remembered: int
    recent: int
    enough: int
    gains: list[int] = field(default_factory=list)
    last: list[int] | None = None
    confidences: list[float] = field(default_factory=list)
    sure: list[bool] = field(default_factory=list)
    taught: int = 0

    def __post_init__(self) -> None:
        n = len(self.weights)
        self.known = [rates(row, self.most, self.spikes) for row in self.references]
        places = len(self.known)
        self.mean = [math.floor(sum(row[i] for row in self.known) / places + 0.5) for i in range(n)]
        self.variance = [max(1, sum((row[i] - self.mean[i]) ** 2 for row in self.known) // places) for i in range(n)]
        self.gains, self.seen, self.start = [FULL] * n, [0.0] * n, 1.0
        self.sums = [[0, 0, 0] for _ in range(n)]

    def see(self, activity: list[float]) -> tuple[list[int], list[int], list[int]]:
        """The next image: its rates without gains, under gains, and the biases of the neurons."""
        plain = rates(activity, self.most, self.spikes)
        full = all(gain == FULL for gain in self.gains)
        under = plain
        if not full:
            weighed = [single(value * gain) for value, gain in zip(activity, self.gains, strict=True)]
            under = rates(weighed, self.most, self.spikes)
        biases = self._biases(full)
        self.query, self.mean_of_queries = (
            plain,
            [round(seen + self.start * mean) for seen, mean in zip(self.seen, self.mean, strict=True)],
        )
        self.new = self._counts(plain)
        if self.new:
            self.seen = [mean + (rate - mean) / self.tau for mean, rate in zip(self.seen, plain, strict=True)]
            self.start -= self.start / self.tau
        return plain, under, biases

    def hear(self, told: Told) -> bool:
        """The answer to it; whether it taught."""
        self.confidences = [*self.confidences, max(told.confidence, -1)][-self.remembered :]
        usual = told.confidence >= sorted(self.confidences)[len(self.confidences) // 2]
        sure = told.probability >= 0.95 if told.tracked else told.probability >= 0.7
        sure = sure and told.place >= 0
        self.sure = [*self.sure, sure][-self.recent :]
        if not (sure and self.new and (told.tracked or usual) and sum(self.sure) >= self.enough):
            return False
        for i, (own, query, both) in enumerate(self.sums):
            matched = self.known[told.place][i] - self.mean[i]
            seen = self.query[i] - self.mean_of_queries[i]
            terms = ((own, matched * matched), (query, seen * seen), (both, matched * seen))
            self.sums[i] = [old - old // FORGETTING + term for old, term in terms]
        self.taught += 1
        if self.taught % self.epoch == 0:
            self.gains = [self._gain(*row, PRIOR * least) for row, least in zip(self.sums, self.variance, strict=True)]
        return True

    def _gain(self, own: int, query: int, both: int, prior: int) -> int:
        """The correlation in fifteenths, none below 0."""
        return min(FULL, round(FULL * max(0, both + prior) / math.sqrt((own + prior) * (query + prior))))

    def _counts(self, plain: list[int]) -> bool:
        """Whether the image shows something that neither the last one that counted nor the mean shows already."""
        if self.last is not None:
            common = sum(map(min, plain, self.last))
            if 5 * common >= 4 * max(sum(plain), sum(self.last)):
                return False
        self.last = plain
        share = 1 - self.start
        value = [rate * share for rate in plain]
        return sum(map(min, value, self.seen)) <= 0.5 * max(sum(value), sum(self.seen))

    def _biases(self, full: bool) -> list[int]:
        """What takes off the mean of the queries before."""
        if full:
            shown = [round(value) for value in self.seen]
            less = [self.start * bias / 64 for bias in self.own]
        else:
            plain = [round(seen + self.start * mean) for seen, mean in zip(self.seen, self.mean, strict=True)]
            under = [rate * gain for rate, gain in zip(plain, self.gains, strict=True)]
            share = sum(plain) / sum(under)
            shown, less = [round(rate * share) for rate in under], [0.0] * len(self.own)
        drives = [sum(r * w[k] for r, w in zip(shown, self.weights, strict=True)) for k in range(len(self.own))]
        wanted = [min(round(-(drive / 65536 - off) * 64), self.safe) for drive, off in zip(drives, less, strict=True)]
        exponent = max(0, max(map(abs, wanted)).bit_length() - 12)
        return [(abs(v) >> exponent << exponent) * (1 if v >= 0 else -1) for v in wanted]
