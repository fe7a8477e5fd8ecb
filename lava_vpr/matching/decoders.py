"""Decoders turn the spike counts of a query into scores of places; each is a row.

A decoder sees the responses S^R (int, (n_exc, n_places): spikes of each neuron on the reference images of each place)
and the spikes s of a query (int, (n_exc,)) and nothing else. `matching.equations` holds the paper's four decoders and
the default, ``contrast``, as functions; the rows here give the function of each variant, the confidence of an answer,
and the decoder's title in reports. A new decoder is a function and a row: settings, commands, files and reports ask
`DECODERS`.

In every command, table and preset the paper's four are what its release computes (variant ``vprsnn2022``); other
variants are chosen by name. `matching.equations` describes them.

Matchers that are not decoders have rows in `MATCHERS`; `confidence` takes the name of either kind. A query without any
score (no spike, or none that distinguishes places) matches no place: `best` is -1, and its confidence is -inf. Equal
scores go to the lowest place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.matching import equations
from lava_vpr.matching.equations import RELEASED, VARIANTS, Counts, Scores, ScoresOf, Variant, check_variant, first_most
from lava_vpr.rows.registry import Registry

Confidence = Callable[[Scores], Scores]
"""A function from scores (n_queries, n_places) with a score in every row to how sure the best one is, float64
(n_queries,)."""


@dataclass(frozen=True)
class Matcher:
    """Something that scores the places for a query.

    Attributes:
        name: Its name in options, settings and files.
        title: Its name in reports.
        confidence: The function of this module that gives the confidence of its best match.
    """

    name: str
    title: str
    confidence: Confidence

    def confidences(self, scores: Scores) -> Scores:
        """The confidence of each query's best match; higher is surer, and only the order within one matcher has a
        meaning.

        Args:
            scores: Scores (n_queries, n_places).
        Returns:
            float64 (n_queries,); -inf where nothing matches (`best` is -1).
        """
        return np.where(scores.any(axis=1), self.confidence(scores), -np.inf)


def best(scores: Scores) -> NDArray[np.int64]:
    """The best place of each query.

    Args:
        scores: Scores (n_queries, n_places), higher is better; distances negated.
    Returns:
        int64 (n_queries,): the lowest of the places with the highest score; -1, no match, where all scores are 0.
    """
    return first_most(scores)


def highest(scores: Scores) -> Scores:
    """The best score of each query."""
    return np.asarray(scores.max(axis=1))


def margin(scores: Scores) -> Scores:
    """The best score of each query minus its second."""
    first, second = _top_two(scores)
    return first - second


def contrast(scores: Scores) -> Scores:
    """The margin over sqrt(best + second + 1): the difference of two counts over its standard deviation by chance."""
    first, second = _top_two(scores)
    return (first - second) / np.sqrt(first + second + 1.0)


def _top_two(scores: Scores) -> tuple[Scores, Scores]:
    """Highest and second highest score of each query, equal ones counted twice; the second of one place is 0."""
    if scores.shape[1] == 1:
        return scores[:, 0], np.zeros(len(scores))
    top = np.partition(scores, scores.shape[1] - 2, axis=1)[:, -2:]
    return top[:, 1], top[:, 0]


@dataclass(frozen=True, eq=False)
class Reading:
    """The reading of the equations.

    Attributes:
        variant: Which form of the paper's four decoders.
        gamma: As in `equations.weighted`.
    """

    variant: Variant = RELEASED
    gamma: float = 0.02


ScoreFunction = Callable[[Counts, Reading], ScoresOf]
"""A function from responses (n_exc, n_places) and the reading to the function that scores queries."""


@dataclass(frozen=True)
class Decoder(Matcher):
    """A decoder: its score function in every variant, and the confidence of its answers.

    Attributes:
        scores: The score function of every variant. Each row of scores, at least 0, depends on that query alone, bit
            for bit; responses or spikes that are no counts or do not fit each other are an `InputError`.
    """

    scores: Mapping[str, ScoreFunction]

    def __post_init__(self) -> None:
        missing = [variant for variant in VARIANTS if not callable(self.scores.get(variant))]
        if missing:
            raise TypeError(f"decoder {self.name!r}: no score function for the variant {', '.join(missing)}")


DECODERS: Registry[Decoder] = Registry("decoder", ConfigError, group="lava_vpr.decoders", row_class=Decoder)
"""All decoders by name, the default one first."""


def in_every_variant(scores: ScoreFunction) -> Mapping[str, ScoreFunction]:
    """``scores`` as the score function of every variant."""
    return dict.fromkeys(VARIANTS, scores)


def _standard(responses: Counts, reading: Reading) -> ScoresOf:
    return equations.standard(responses, variant=reading.variant)


def _weighted(responses: Counts, reading: Reading) -> ScoresOf:
    return equations.weighted(responses, gamma=reading.gamma, variant=reading.variant)


def _probability_of(scores: ScoreFunction, printed: ScoreFunction) -> Mapping[str, ScoreFunction]:
    """The released code's probability of other ``scores`` in every variant but ``printed``, which has its own."""

    def released(responses: Counts, reading: Reading) -> ScoresOf:
        scores_of = scores(responses, reading)
        return lambda spikes: equations.probability(scores_of(spikes))

    return {**in_every_variant(released), "printed": printed}


for _row in (
    Decoder(
        "contrast",
        title="contrast",
        confidence=contrast,
        scores=in_every_variant(lambda responses, reading: equations.contrast(responses)),
    ),
    Decoder("standard", title="standard", confidence=highest, scores=in_every_variant(_standard)),
    Decoder("weighted", title="weighted", confidence=highest, scores=in_every_variant(_weighted)),
    Decoder(
        "probability",
        title="probability",
        confidence=highest,
        scores=_probability_of(_standard, lambda responses, reading: equations.standard_probability(responses)),
    ),
    Decoder(
        "weighted_probability",
        title="weighted + probability",
        confidence=highest,
        scores=_probability_of(
            _weighted, lambda responses, reading: equations.weighted_probability(responses, reading.gamma)
        ),
    ),
):
    DECODERS.register(_row)


def decode(
    name: str,
    responses: Counts,
    spikes: Counts,
    *,
    variant: Variant = RELEASED,
    gamma: float = 0.02,
) -> Scores:
    """Place scores of the named decoder.

    Args:
        name: A decoder in `DECODERS`.
        responses: S^R, int (n_exc, n_places).
        spikes: Query spikes, int (n_queries, n_exc).
        variant, gamma: See `Reading`.
    Returns:
        Scores (n_queries, n_places), at least 0; each row depends on that query alone, bit for bit.
    Raises:
        ConfigError: unknown name or variant.
        InputError: arrays that are no counts or do not fit each other.
    """
    return prepare(name, responses, variant=variant, gamma=gamma)(spikes)


def prepare(
    name: str,
    responses: Counts,
    *,
    variant: Variant = RELEASED,
    gamma: float = 0.02,
) -> ScoresOf:
    """Prepare `decode` for many queries: the part that depends on ``responses`` alone is computed once.

    Raises:
        ConfigError, InputError: as `decode`, and what is returned, too.
    """
    check_variant(variant)
    return DECODERS[name].scores[variant](responses, Reading(variant, gamma))


MATCHERS: Registry[Matcher] = Registry("matcher", ConfigError)
"""The baselines of `matching.baselines`, and ``sequence``: the scores of any matcher, added up over a sequence."""
for _matcher in (
    Matcher("sad", title="SAD", confidence=highest),  # distances, negated
    Matcher("cosine", title="cosine of the inputs", confidence=margin),
    Matcher("hog", title="HOG", confidence=margin),
    Matcher("template", title="no learning", confidence=contrast),
    Matcher("descriptors", title="descriptors", confidence=margin),
    Matcher("vectors", title="cosine of the vectors", confidence=margin),
    Matcher("standardised", title="standardised vectors", confidence=margin),
    Matcher("sequence", title="sequence", confidence=margin),
):
    MATCHERS.register(_matcher)


def confidence(name: str, scores: Scores) -> Scores:
    """The confidence of the matcher ``name`` in each query's best match; see `Matcher.confidences`.

    Args:
        name: A decoder in `DECODERS`, or a matcher in `MATCHERS`.
        scores: Scores (n_queries, n_places).
    Raises:
        ConfigError: unknown name.
    """
    if name not in DECODERS and name not in MATCHERS:
        raise ConfigError(f"there is no matcher {name!r}; choose from {', '.join((*DECODERS, *MATCHERS))}")
    matcher: Matcher = DECODERS[name] if name in DECODERS else MATCHERS[name]
    return matcher.confidences(scores)
