"""Matchers that are no decoders, one row each, and what is asked of a matcher of either sort by its name."""

from __future__ import annotations

from lava_vpr.errors import ConfigError
from lava_vpr.matching import certainty
from lava_vpr.matching.certainty import Matcher
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.matching.equations import Scores
from lava_vpr.rows.registry import Registry

MATCHERS: Registry[Matcher] = Registry("matcher", ConfigError)
"""The baselines of `matching.baselines`, and ``sequence``: the scores of any matcher, added up over a sequence."""
MATCHERS.register(Matcher("sad", title="SAD", confidence=certainty.highest))  # distances, negated
MATCHERS.register(Matcher("cosine", title="cosine of the inputs", confidence=certainty.margin))
MATCHERS.register(Matcher("hog", title="HOG", confidence=certainty.margin))
MATCHERS.register(Matcher("template", title="no learning", confidence=certainty.contrast))
MATCHERS.register(Matcher("descriptors", title="descriptors", confidence=certainty.margin))
MATCHERS.register(Matcher("vectors", title="cosine of the vectors", confidence=certainty.margin))
MATCHERS.register(Matcher("standardised", title="standardised vectors", confidence=certainty.margin))
MATCHERS.register(Matcher("sequence", title="sequence", confidence=certainty.margin))


def confidence(name: str, scores: Scores) -> Scores:
    """How sure the matcher called ``name`` is of each query's best match; see `Matcher.confidences`.

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
