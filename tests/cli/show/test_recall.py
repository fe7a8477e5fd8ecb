"""What the terminal shows of a recognition, from made-up results."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from lava_vpr.cli.show.recall import in_words, trust_tables
from lava_vpr.matching.probability import UNREACHED
from lava_vpr.matching.trust import TARGETS, Threshold, Trust
from lava_vpr.recognition import FILTERED, SINGLE, Recognition
from lava_vpr.show.table import Table


def trust_at(least: float, off_map: float = 0.0) -> Trust:
    """Trust in answers of which those with a probability of ``least`` are accepted."""
    rows = tuple(Threshold(target, least, 0.5, 1.0, 0.5, math.nan) for target in TARGETS)
    return Trust(error=0.1, bins=(), thresholds=rows, off_map=off_map)


def made(**parts: object) -> Recognition:
    """A recognition with these parts alone."""
    return cast("Recognition", SimpleNamespace(**parts))


def test_the_sentence_counts_matches_with_a_true_place() -> None:
    """A query without a match is not recognised, even where the last place would be right, nor is one off the map."""
    truth = np.array([[True, False], [False, True], [False, True], [True, False], [False, False]])
    found = made(matches=np.array([0, 1, -1, 1, 0]), truth=truth)
    assert in_words(found) == "Recognised the place in 2 of 5 queries."
    assert in_words(found, 3) == "Recognised the place in 2 of 5 sequences of 3 queries."


@pytest.mark.parametrize(("off_map", "said"), [(0.0, "no query is off the map"), (0.25, "25.0 % of the queries are")])
def test_trust_tells_what_probabilities_assume(off_map: float, said: str) -> None:
    (table,) = trust_tables(made(trust={SINGLE: trust_at(0.8, off_map), FILTERED: trust_at(0.9)}))
    assert isinstance(table, Table)
    assert any(note.startswith(said) and note.endswith("assume half (--off-map)") for note in table.notes)
    assert "single: each query alone" in table.notes


def test_where_no_probability_is_high_enough_the_remedies_are_named() -> None:
    never = trust_at(math.inf)
    assert trust_tables(made(trust={SINGLE: never})) == [UNREACHED]
    table, said = trust_tables(made(trust={SINGLE: never, FILTERED: trust_at(0.9)}))
    assert isinstance(table, Table)
    assert said == f"single: {UNREACHED}"
    assert "--off-map 0" in UNREACHED
    assert "--target-precision" in UNREACHED
    assert trust_tables(made(trust={})) == []
