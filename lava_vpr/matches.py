"""The record of an answer: a `Match` in Python, and its values as JSON lines, tables and messages show them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.inputs.doubts import Sign
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.inputs.likeness import Likeness
from lava_vpr.matching.answers import Answers
from lava_vpr.matching.forward_filter import FASTEST
from lava_vpr.model import Model
from lava_vpr.positions.frames import LAT_LON, columns


@dataclass(frozen=True)
class Candidate:
    """A place that an image may show.

    Attributes:
        place: Its absolute index in the reference traverse.
        name: File name of its reference image.
        score: The decoder's score of the image at this place.
        probability: Probability of this place; NaN for all but the first where each image is answered alone.
    """

    place: int
    name: str
    score: float
    probability: float


@dataclass(frozen=True)
class Match:
    """Where an image was taken.

    Attributes:
        place: Absolute index of the best place in the reference traverse, also if it is not accepted; -1: the image
            matches none.
        name: File name of that place's reference image; empty without a place.
        position: Coordinates of that place in ``frame``; None without a place, or where they are not known.
        frame: Frame of the position (`lava_vpr.positions.frames`).
        probability: Probability that the robot is there, within ``radius`` places; NaN where it is not known.
        accepted: Whether that probability reaches the threshold for the target precision, and the image is not
            doubtful.
        radius: See ``probability``: 0 where each image is answered alone.
        off_map: Probability that the robot is off the map; NaN where each image is answered alone.
        followed: Probability that the previous images tell where this one is; NaN where each image is answered alone.
        confidence: How sure the decoder is of this image alone; -inf if the image made no neuron spike.
        candidates: The best places, best first; none without a place.
        spikes: Spike counts of the neurons, int32 (neurons,).
        stamp: What `lava_vpr.Localizer.update` was given.
        repeats: How many images in a row before it were identical to it (`lava_vpr.inputs.doubts`).
        cause: What is wrong with a run of images up to this one, of which none is accepted: ``stuck camera``, the same
            image while the robot moves; ``border``, empty edges that the map has not; ``blank``; ``mirrored``;
            ``upside down``. None: nothing.
        time_fault: What is wrong with ``stamp`` beside those before: ``backwards``, ``not a number`` or ``gap``; None:
            nothing.
        unlike: How far the image is from all that the map has seen (`lava_vpr.inputs.likeness`); from 1 on, which is
            farther than another season, it is not accepted. NaN: not known.
    """

    place: int
    name: str
    position: tuple[float, float] | None
    frame: str | None
    probability: float
    accepted: bool
    radius: int
    off_map: float
    followed: float
    confidence: float
    candidates: tuple[Candidate, ...]
    spikes: NDArray[np.int32] = field(repr=False)
    stamp: float | None = None
    repeats: int = 0
    cause: str | None = None
    time_fault: str | None = None
    unlike: float = math.nan

    def values(self) -> dict[str, Any]:
        """The match as plain JSON values; what is not known is None.

        Probabilities are rounded to six digits, times to microseconds, positions to a centimetre. The two coordinates
        are left out if the map has none, and signs of doubt unless the image is doubtful.
        """
        there = self.place >= 0
        said: dict[str, Any] = {
            "time": None if self.stamp is None else _finite(self.stamp, 6),
            "place": self.place,
            "place_name": self.name if there else None,
            "confidence": _finite(self.confidence) if there else None,
            "accepted": self.accepted,
            "probability": _finite(self.probability, 6) if there else None,
        }
        if self.frame is not None:
            digits = 7 if self.frame == LAT_LON else 2
            position = (None, None) if self.position is None else (round(value, digits) for value in self.position)
            said |= zip(columns(self.frame), position, strict=True)
        said["radius"], said["off_map"] = self.radius, _finite(self.off_map, 6)
        said["followed"] = _finite(self.followed, 6)
        said["candidates"] = [
            {
                "place": candidate.place,
                "place_name": candidate.name,
                "score": candidate.score,
                "probability": _finite(candidate.probability, 6),
            }
            for candidate in self.candidates
        ]
        against: dict[str, Any] = {"repeats": self.repeats or None, "cause": self.cause, "time_fault": self.time_fault}
        against["unlike"] = _finite(self.unlike, 3) if self.unlike >= 1 else None
        return said | {name: value for name, value in against.items() if value is not None}


@dataclass
class Unfollowed:
    """Counts accepted matches that rest on their images alone, though a filter looks at those before.

    Attributes:
        accepted: How many matches are accepted.
        alone: How many of them are of images that are not followed.
    """

    accepted: int = 0
    alone: int = 0

    def add(self, *matches: Match) -> None:
        """Count some matches."""
        good = [match.followed < 0.5 for match in matches if match.accepted]
        self.accepted, self.alone = self.accepted + len(good), self.alone + sum(good)

    @property
    def said(self) -> str | None:
        """What the robot's maker should know, of at least 20 accepted matches; None if most are followed."""
        if self.accepted < 20 or 2 * self.alone < self.accepted:
            return None
        return (
            f"{self.alone} of {self.accepted} accepted matches rest on their image alone: images are in no order, or "
            f"further apart than the filter follows ({FASTEST} places); take them more often"
        )


def likeness_of(model: Model) -> Likeness | None:
    """What the references of ``model`` have in common; None where its inputs are no orientations."""
    layout = model.config.encoder.layout
    known = INPUTS[model.config.encoder.kind].oriented and len(model.activity) > 1
    return Likeness.of(model.activity, layout.channels, layout.grid) if known else None


def matches_of(
    model: Model,
    answers: Answers,
    accepted: NDArray[np.bool_],
    counts: NDArray[np.int32],
    *,
    radius: int = 0,
    top: int = 1,
    stamps: NDArray[np.float64] | None = None,
    signs: Sequence[Sign] | None = None,
) -> list[Match]:
    """The match of each of n queries.

    Args:
        model: The model that answered.
        answers: Its answers.
        accepted: Which of them are accepted, bool (n,).
        counts: Spike counts, int32 (n, neurons).
        radius: Places that a probability includes on either side (`Together.radius`).
        top: Most candidates of a match; 1: none but the match itself, and none are named.
        stamps: When each query was taken, in seconds, float64 (n,); None: unknown.
        signs: Signs of doubt of each of them; None: nobody looked.
    """
    unknown = np.full(len(accepted), np.nan)
    off_map, followed = (unknown if known is None else known for known in (answers.off_map, answers.followed))
    chances = answers.probability.tolist()
    if answers.off_map is not None:  # sums of beliefs, which may exceed 1 by their rounding
        chances = [round(chance, 9) for chance in chances]
    named = _candidates(model, answers, top) if top > 1 else [()] * len(accepted)
    found = []
    against = [Sign()] * len(accepted) if signs is None else signs
    for number, (place, sign) in enumerate(zip(answers.matches.tolist(), against, strict=True)):
        there = place >= 0
        found.append(
            Match(
                place=int(model.place_indices[place]) if there else -1,
                name=model.place_names[place] if there else "",
                position=_position(model, place),
                frame=model.frame,
                probability=chances[number],
                accepted=bool(accepted[number]) and not sign.doubtful,
                radius=radius,
                off_map=float(off_map[number]),
                followed=float(followed[number]),
                confidence=float(answers.confidence[number]),
                candidates=named[number],
                spikes=counts[number],
                stamp=None if stamps is None else float(stamps[number]),
                repeats=sign.repeats,
                cause=sign.cause,
                time_fault=sign.time_fault,
                unlike=sign.unlike,
            )
        )
    return found


def _position(model: Model, place: int) -> tuple[float, float] | None:
    """The coordinates of a place, if there are any."""
    if place < 0 or model.positions is None:
        return None
    first, second = model.positions[place].tolist()
    return float(first), float(second)


def _candidates(model: Model, answers: Answers, top: int) -> list[tuple[Candidate, ...]]:
    """The ``top`` best places of each query."""
    rows = zip(*(array.tolist() for array in answers.candidates(top)), strict=True)
    return [
        tuple(
            Candidate(int(model.place_indices[place]), model.place_names[place], score, chance)
            for place, score, chance in zip(*row, strict=True)
            if place >= 0
        )
        for row in rows
    ]


def _finite(value: float, digits: int | None = None) -> float | None:
    """``value``, to so many digits; None where it is not finite."""
    if not math.isfinite(value):
        return None
    return value if digits is None else round(value, digits)
