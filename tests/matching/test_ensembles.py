"""Ensembles, beside a literal sum."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from lava_vpr.errors import InputError
from lava_vpr.matching.ensembles import in_order, together

SCORES = st.integers(0, 5).map(float)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_members_in_any_order_add_up_place_by_place(data: st.DataObject) -> None:
    n, places, members = (data.draw(st.integers(1, most)) for most in (4, 6, 4))
    orders = [np.array(data.draw(st.permutations(range(places)))) for _ in range(members)]
    scores = [data.draw(arrays(np.float64, (n, places), elements=SCORES)) for _ in range(members)]
    found = together([in_order(some, order) for some, order in zip(scores, orders, strict=True)])
    for query in range(n):
        for place in range(places):
            parts = [scores[m][query, k] for m in range(members) for k in range(places) if orders[m][k] == place]
            assert found[query, place] == sum(parts)


def test_members_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match=re.escape("scores of shapes (1, 2), (1, 3)")):
        together([np.zeros((1, 2)), np.zeros((1, 3))])
    with pytest.raises(InputError, match="scores of shapes none"):
        together([])
    with pytest.raises(InputError, match=re.escape("the order of 2 places does not fit scores (1, 2)")):
        in_order(np.zeros((1, 2)), np.array([0, 0]))


def test_what_was_given_stays() -> None:
    first = np.ones((1, 2))
    together([first, first])
    assert first.tolist() == [[1.0, 1.0]]
