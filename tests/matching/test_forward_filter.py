"""The forward filter, beside a literal hidden Markov model written as one matrix, and on drives of every sort."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError, InputError
from lava_vpr.matching.answers import Answerer, Together
from lava_vpr.matching.forward_filter import Belief, ForwardFilter, filtered, smooth

PLACES = 60
STEPS = {
    "any": {-3: 1 / 14, -2: 2 / 14, -1: 3 / 14, 0: 2 / 14, 1: 3 / 14, 2: 2 / 14, 3: 1 / 14},
    "forward": {0: 2 / 8, 1: 3 / 8, 2: 2 / 8, 3: 1 / 8},
}
"""Share of each step in places."""


def matrix(n: int, motion: str) -> NDArray[np.float64]:
    """How a belief over n places and off the map moves, (n + 1, n + 1): row to column."""
    moves = np.zeros((n + 1, n + 1))
    for place in range(n):
        for step, share in STEPS[motion].items():
            to = place + step
            moves[place, to if 0 <= to < n else n] += 0.98 * share
        moves[place, :n] += 0.01 / n
        moves[place, n] += 0.01
    moves[n, :n] = 0.01 / n
    moves[n, n] = 0.99
    return moves


def likelihoods(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of every state, (queries, n + 1)."""
    squares = scores**2
    peak = {9: 2.7, 250: 60.0}[scores.shape[1]]
    rows = [0.1 + peak * row / row.sum() if row.any() else np.ones(len(row)) for row in squares]
    return np.concatenate([np.array(rows), np.ones((len(scores), 1))], axis=1)


def drawn(seed: int, queries: int = 12, n: int = 9) -> NDArray[np.float64]:
    """Scores without any order, one query without a spike."""
    scores = np.random.default_rng(seed).gamma(0.4, 4.0, (queries, n))
    scores[3] = 0.0
    return scores


@pytest.mark.parametrize("motion", STEPS)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("n", [9, 250])
def test_the_filter_is_the_markov_model(motion: str, seed: int, n: int) -> None:
    scores = drawn(seed, n=n)
    moves, seen = matrix(n, motion), likelihoods(scores)
    assert moves.sum(axis=1) == pytest.approx(np.ones(n + 1))
    state = np.append(np.full(n, 0.5 / n), 0.5)
    forward = []
    for number, row in enumerate(seen):
        state = (state if number == 0 else state @ moves) * row
        state = state / state.sum()
        forward.append(state)
    start, moving = ForwardFilter(Belief.unknown(n), motion), np.ones(len(scores), bool)
    _, beliefs = filtered(start, scores, moving)
    found = np.concatenate([beliefs.places, beliefs.off_map[:, None]], axis=1)
    np.testing.assert_allclose(found, np.array(forward), rtol=1e-10)
    later = np.ones(n + 1)
    both = [forward[-1]]
    for number in range(len(seen) - 1, 0, -1):
        later = moves @ (seen[number] * later)
        later = later / later.max()
        told = forward[number - 1] * later
        both.append(told / told.sum())
    smooth(start, beliefs, scores, moving)
    found = np.concatenate([beliefs.places, beliefs.off_map[:, None]], axis=1)
    np.testing.assert_allclose(found, np.array(both[::-1]), rtol=1e-9)


def world(seed: int, place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Scores of queries at these places (-1: off the map), two in ten of which look like another place."""
    rng = np.random.default_rng(seed)
    looks = np.round(rng.gamma(1.0, 1.2, (PLACES, PLACES)))
    fooled = rng.random(PLACES) < 0.2
    looks[np.arange(PLACES), np.where(fooled, rng.integers(0, PLACES, PLACES), np.arange(PLACES))] += 12
    looks[np.arange(PLACES), np.arange(PLACES)] += 3
    nowhere = np.round(rng.gamma(1.0, 1.2, (len(place), PLACES)))
    return np.where(place[:, None] >= 0, looks[place], nowhere)


DRIVES = {
    "at half the speed": np.repeat(np.arange(PLACES), 2),
    "at the same speed": np.arange(PLACES),
    "1.5 times as fast": (np.arange(PLACES // 1.5) * 1.5).astype(np.int64),
    "twice as fast": np.arange(0, PLACES, 2),
    "with stops": np.concatenate([np.full(20 if k % 15 == 7 else 1, k) for k in range(PLACES)]),
    "backwards": np.arange(PLACES)[::-1],
    "there and back": np.concatenate([np.arange(PLACES), np.arange(PLACES)[::-1]]),
}


@pytest.mark.parametrize("drive", DRIVES)
def test_a_drive_at_any_speed_is_followed(drive: str) -> None:
    truth = DRIVES[drive]
    scores = world(1, truth)
    moving = np.append(True, np.diff(truth) != 0)
    alone = float((scores.argmax(axis=1) == truth).mean())
    _, beliefs = filtered(ForwardFilter(Belief.unknown(PLACES)), scores, moving)
    places, chance = beliefs.best()
    near = np.abs(places - truth) <= 1
    assert near.mean() > max(alone, 0.9)
    assert (near | (chance < 0.95)).mean() > 0.98


def test_who_is_carried_off_is_found_again() -> None:
    truth = np.concatenate([np.arange(5, 25), np.arange(40, 52)])
    _, beliefs = filtered(ForwardFilter(Belief.unknown(PLACES)), world(2, truth), np.ones(len(truth), bool))
    places, _ = beliefs.best()
    assert np.array_equal(places[-4:], truth[-4:])


def test_off_the_map_is_an_answer() -> None:
    truth = np.concatenate([np.arange(10, 40), np.full(25, -1)])
    _, beliefs = filtered(ForwardFilter(Belief.unknown(PLACES)), world(3, truth), np.ones(len(truth), bool))
    assert beliefs.off_map[-10:].min() > 0.9
    assert beliefs.off_map[10:30].max() < 0.3
    assert beliefs.best()[1][-10:].max() < 0.1


def test_standing_still_is_no_news() -> None:
    state = ForwardFilter(Belief.unknown(5)).update(np.array([1.0, 4, 0, 0, 0]))
    assert state.update(np.array([0.0, 0, 0, 9, 0]), moving=False) is state


def test_odometry_takes_the_belief_along() -> None:
    along = np.cumsum(np.array([0.0, 5, 5, 20, 5, 5, 5, 30, 5, 5]))
    state = ForwardFilter(Belief(np.eye(10)[1], 0.0), "forward", along)
    carried = state.moved(state.belief, 25.0)
    assert carried.places.argmax() == 3
    both = ForwardFilter(state.belief, "any", along).moved(state.belief, 5.0)
    assert both.places[[0, 2]].min() > both.places[4:].max()
    gone = state.moved(state.belief, 500.0)
    assert gone.off_map > 0.9
    for belief in (carried, both, gone):
        assert belief.places.sum() + belief.off_map == pytest.approx(1.0)


@pytest.mark.parametrize(("motion", "ahead", "back"), [("forward", 1.0, 0.0), ("any", 0.5, 0.5)])
def test_odometry_by_hand(motion: str, ahead: float, back: float) -> None:
    """30 m from place 5 of places 10 m apart: a quarter each to 3 places less and more a tenth, half to 3; blurred."""
    bump = [0.01875, 0.25, 0.4625, 0.25, 0.01875]  # of 0.075, 0.85, 0.075: a quarter to either side
    state = ForwardFilter(Belief(np.eye(11)[5], 0.0), motion, 10.0 * np.arange(11))
    moved = state.moved(state.belief, 30.0)
    wanted = np.full(11, 0.01 / 11)
    wanted[6:11] += 0.98 * ahead * np.array(bump)
    wanted[0:5] += 0.98 * back * np.array(bump)
    np.testing.assert_allclose(moved.places, wanted, rtol=1e-12)
    assert moved.off_map == pytest.approx(0.01)


def test_what_makes_no_sense_is_refused() -> None:
    state = ForwardFilter(Belief.unknown(4))
    with pytest.raises(InputError, match=r"scores of shape \(3,\) for 4 places"):
        state.update(np.ones(3))
    with pytest.raises(InputError, match="odometry needs a map with positions"):
        state.update(np.ones(4), odometry=1.0)
    with pytest.raises(InputError, match="finite number of metres"):
        ForwardFilter(Belief.unknown(4), "any", np.arange(4.0)).update(np.ones(4), odometry=float("nan"))
    with pytest.raises(ConfigError, match="there is no motion 'sideways'; choose from any, forward, none"):
        Together(motion="sideways")
    with pytest.raises(ConfigError, match="both look back"):
        Together(sequence=5, motion="any")


@pytest.mark.parametrize("cuts", [[], [1], [4, 5, 9]])
def test_a_stream_is_followed_in_any_parts(cuts: list[int]) -> None:
    scores, moving = drawn(1), np.random.default_rng(0).random(12) < 0.7
    _, beliefs = filtered(ForwardFilter(Belief.unknown(9)), scores, moving)
    whole = beliefs.best()
    state, found = Answerer.of("contrast", 9, Together(motion="any")), []
    for some, moves in zip(np.split(scores, cuts), np.split(moving, cuts), strict=True):
        state, answers = state.step(some, moves)
        found.append(answers)
    assert np.array_equal(np.concatenate([answers.matches for answers in found]), whole[0])
    assert np.concatenate([answers.probability for answers in found]) == pytest.approx(whole[1], abs=1e-8)
