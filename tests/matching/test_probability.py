"""Probabilities of single queries: the curve beside scipy's optimum, the rest beside plain counting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from lava_vpr.errors import ConfigError
from lava_vpr.matching.answers import ALONE, Answerer, Answers, Together, accepted, answers_of, least_probability
from lava_vpr.matching.decoders import margin
from lava_vpr.matching.probability import OFF_MAP, RIGHT, VARIED_RIGHT, VARIED_WRONG, WRONG, Calibration, reliability
from lava_vpr.matching.trust import trust


def samples(seed: int, on_map: int = 300, off_map: int = 200) -> NDArray[np.float32]:
    """Margins as they come: large where right, small where wrong or off the map."""
    rng = np.random.default_rng(seed)
    right = rng.random(on_map) < 0.9
    margins = np.where(right, rng.gamma(4.0, 3.0, on_map), rng.gamma(1.0, 1.5, on_map))
    on = np.stack([margins, np.where(right, RIGHT, WRONG)], axis=1)
    off = np.stack([rng.gamma(1.2, 2.0, off_map), np.full(off_map, OFF_MAP)], axis=1)
    return np.concatenate([on, off]).astype(np.float32)


def varied(seed: int) -> NDArray[np.float32]:
    """The same, and of more on the map that are wrong more often."""
    more = samples(seed + 100, 150, 0)
    return np.concatenate([samples(seed), np.stack([more[:, 0] / 2, more[:, 1] + VARIED_WRONG], axis=1)])


FAR = np.array([[10, RIGHT]] * 5 + [[1000, RIGHT]] + [[1, OFF_MAP]] * 50 + [[12, OFF_MAP]] * 3, np.float32)
"""Of which one margin is a hundred times the others."""


@pytest.mark.parametrize("taken", [*map(samples, range(5)), FAR])
def test_the_curve_is_the_likeliest(taken: NDArray[np.float32]) -> None:
    off = taken[:, 1] == OFF_MAP
    weights = np.where(off, 0.5 / off.sum(), 0.5 / (~off).sum())
    wanted = likeliest(taken[:, 0].astype(float), taken[:, 1] == RIGHT, weights)
    assert Calibration(taken).curve == pytest.approx(wanted, rel=1e-4)


def test_all_on_the_map_the_varied_ones_count_and_half_off_it_the_others() -> None:
    taken = varied(0)
    known, without = Calibration(taken), Calibration(samples(0))
    assert (known.curve, known.keeping(0.9)) == (without.curve, without.keeping(0.9))
    counts = taken[taken[:, 1] != RIGHT]
    counts = counts[counts[:, 1] != WRONG]
    weights = (counts[:, 1] != OFF_MAP) / 150
    wanted = likeliest(counts[:, 0].astype(float), counts[:, 1] == VARIED_RIGHT, weights)
    assert known.on_map == pytest.approx(wanted, rel=1e-4)


def likeliest(
    margins: NDArray[np.float64], right: NDArray[np.bool_], weights: NDArray[np.float64]
) -> tuple[float, float]:
    """Offset and slope of the curve."""
    spread = margins.std()

    def loss(curve: NDArray[np.float64]) -> float:
        exponents = np.where(right, -1.0, 1.0) * (curve[0] + curve[1] * margins)
        return float((weights * np.logaddexp(0.0, exponents)).sum() + 1e-3 * (curve[1] * spread) ** 2)

    found = minimize(loss, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-14, "maxiter": 4000})
    return float(found.x[0]), float(found.x[1])


def test_probability_follows_the_margin() -> None:
    calibration = Calibration(samples(0))
    scores = np.array([[0.0, 0, 0], [5, 5, 0], [6, 0, 3], [20, 1, 0], [2.5, 2, 1]])
    chances = calibration.probabilities(scores)
    assert chances[0] == 0.0
    order = np.argsort(margin(scores)[1:], kind="stable")
    assert (np.diff(chances[1:][order]) > 0).all()
    offset, slope = calibration.curve
    assert chances[3] == pytest.approx(1 / (1 + math.exp(-(offset + slope * 19))), abs=1e-9)
    answers = answers_of("contrast", scores, calibration)
    assert np.array_equal(answers.probability, chances)
    assert np.isnan(answers_of("contrast", scores).probability).all()


@pytest.mark.parametrize("off_map", [0.0, 0.1, 0.5, 0.9])
def test_the_prior_enters_by_bayes_rule(off_map: float) -> None:
    """Right margins are twice as large as others, all of gamma's shape 2: they are e^(m/2) / 4 times as likely at m."""
    rng = np.random.default_rng(1)
    margins = rng.gamma(2.0, np.repeat([2.0, 1.0, 1.0], [16000, 4000, 20000]))
    kinds = np.repeat([RIGHT, WRONG, OFF_MAP], [16000, 4000, 20000])
    calibration = Calibration(np.stack([margins, kinds], axis=1).astype(np.float32))
    asked = np.arange(0.5, 12.0, 0.5)
    scores = np.stack([asked + 3.0, np.full(len(asked), 3.0)], axis=1)
    right, wrong = (1 - off_map) * 0.8 * np.exp(asked / 2) / 4, (1 - off_map) * 0.2
    found = calibration.probabilities(scores, off_map)
    assert found == pytest.approx(right / (right + wrong + off_map), abs=0.02)
    assert calibration.probabilities(np.zeros((1, 2)), off_map) == 0.0


def test_margins_that_tell_nothing_give_half_of_the_right_a_chance() -> None:
    flat = np.array([[1, RIGHT], [1, RIGHT], [1, OFF_MAP], [1, OFF_MAP]], np.float32)
    assert Calibration(flat).probabilities(np.array([[9.0, 1.0]])) == pytest.approx([0.5], abs=1e-6)
    reversed_ = np.array([[1, RIGHT], [9, OFF_MAP]], np.float32)
    assert Calibration(reversed_).curve.slope == 0.0


@pytest.mark.parametrize("taken", [samples(3), varied(3)], ids=["altered", "varied"])
@pytest.mark.parametrize("off_map", [0.6, 0.5, 0.2])
@pytest.mark.parametrize("precision", [0.8, 0.9, 0.95, 0.99])
def test_a_threshold_keeps_as_much_as_the_precision_allows(
    taken: NDArray[np.float32], precision: float, off_map: float
) -> None:
    calibration = Calibration(taken)
    kept = calibration.keeping(precision, off_map)
    scores = np.stack([taken[:, 0].astype(float), np.zeros(len(taken))], axis=1)
    chances = calibration.probabilities(scores + 1.0, off_map)
    off = taken[:, 1] == OFF_MAP
    more = taken[:, 1] >= 2
    share = {0.6: 0.0, 0.5: 0.0, 0.2: 0.6}[off_map] if more.any() else 0.0
    on_map = np.where(more, share / max(1, more.sum()), (1 - share) / (~off & ~more).sum())
    weights = np.where(off, off_map / off.sum(), (1 - off_map) * on_map)

    def by(least: float) -> float:
        good = chances >= least
        return float((weights * chances)[good].sum() / weights[good].sum())

    assert by(kept.probability) == pytest.approx(kept.precision)
    assert kept.precision >= precision
    lower = chances[(chances < kept.probability) & (weights > 0)]
    assert len(lower) == 0 or by(lower.max()) < precision
    assert kept.kept == pytest.approx((chances[~off & (weights > 0)] >= kept.probability).mean())
    assert kept.false_accepts == pytest.approx((chances[off] >= kept.probability).mean())


def test_what_no_threshold_reaches_keeps_nothing() -> None:
    hopeless = np.array([[k, OFF_MAP if k % 2 else RIGHT] for k in range(10)], np.float32)
    kept = Calibration(hopeless).keeping(0.999)
    assert (kept.probability, kept.kept, kept.false_accepts) == (math.inf, 0.0, 0.0)
    together = Together(calibration=Calibration(hopeless))
    answers = answers_of("contrast", np.array([[99.0, 0.0]]), together.calibration)
    assert not accepted(answers, least_probability(together, 0.999)).any()


@pytest.mark.parametrize("precision", [0.0, 1.0, -0.5, 2.0, math.nan])
def test_a_precision_out_of_range_is_refused(precision: float) -> None:
    with pytest.raises(ConfigError, match="above 0 and below 1"):
        least_probability(ALONE, precision)


@pytest.mark.parametrize("share", [1.0, -0.1, 2.0, math.nan])
def test_what_can_be_no_share_of_the_queries_is_refused(share: float) -> None:
    with pytest.raises(ConfigError, match="at least 0, below 1"):
        Together(off_map=share)


@pytest.mark.parametrize(("precision", "kept", "false_accepts"), [(0.4, 1.0, 1.0), (0.7, 0.5, 0.125), (0.9, 0.0, 0.0)])
def test_equal_margins_are_accepted_together(precision: float, kept: float, false_accepts: float) -> None:
    """At 9 is a quarter of the weight, on the map, beside a sixteenth off it: 0.8 are right. At 1: 1/4 beside 7/16."""
    taken = np.array([[9, RIGHT]] * 4 + [[9, OFF_MAP]] + [[1, RIGHT]] * 4 + [[1, OFF_MAP]] * 7, np.float32)
    calibration = Calibration(taken)
    found = calibration.keeping(precision)
    assert (found.kept, found.false_accepts) == (kept, false_accepts)
    assert calibration.probabilities(np.array([[9.0, 0.0], [1.0, 0.0]])) == pytest.approx([0.8, 4 / 11], abs=0.005)


@pytest.mark.parametrize("precision", [0.4, 0.7, 0.9])
def test_filtered_answers_are_accepted_as_single_ones_or_from_the_precision_on(precision: float) -> None:
    """By the curve, 0.8 at a margin of 9 and 4/11 at one of 1: 0.4 keeps both, 0.7 the surer, and 0.9 neither."""
    known = Calibration(np.array([[9, RIGHT]] * 4 + [[9, OFF_MAP]] + [[1, RIGHT]] * 4 + [[1, OFF_MAP]] * 7, np.float32))
    least = {0.4: 4 / 11, 0.7: 0.7, 0.9: 0.9}[precision]
    assert least_probability(Together(motion="any", calibration=known), precision) == pytest.approx(least, abs=0.005)
    assert least_probability(Together(motion="any"), precision) == precision
    single = least_probability(Together(calibration=known), precision)
    assert single == known.keeping(precision).probability
    assert precision < 0.9 or math.isinf(single)


@pytest.mark.parametrize(
    ("together", "remedy"), [(ALONE, "give --motion any"), (Together(2), "--motion any in place of --sequence 2")]
)
def test_no_match_is_accepted_without_a_probability(
    together: Together, remedy: str, caplog: pytest.LogCaptureFixture
) -> None:
    scores = np.array([[3.0, 1.0, 0.0], [0.0, 9.0, 1.0], [0.0, 0.0, 0.0]])
    _, answers = Answerer.of("contrast", 3, together).step(scores)
    assert (answers.matches >= 0).any()
    assert not accepted(answers, least_probability(together)).any()
    assert caplog.messages == [f"no match is accepted: {together.unknown}"]
    assert trust(answers, np.eye(3, dtype=bool), together) is None
    with pytest.raises(ConfigError, match=rf"^a target precision of 0\.9 needs probabilities, but .*; .*{remedy}$"):
        least_probability(together, 0.9)


def test_reliability_counts_plainly() -> None:
    rng = np.random.default_rng(5)
    chance = rng.random(400)
    right = rng.random(400) < chance**2
    bins, error = reliability(chance, right)
    wanted = 0.0
    for k in range(10):
        inside = (chance >= k / 10) & (chance < (k + 1) / 10)
        wanted += inside.sum() * abs(chance[inside].mean() - right[inside].mean()) / 400
        assert bins[k].answers == inside.sum()
    assert error == pytest.approx(wanted)
    # The last digit does not depend on the order of sums, which Pythons and numpys have of their own.
    for order in (np.arange(400)[::-1], rng.permutation(400), rng.permutation(400)):
        assert reliability(chance[order], right[order]) == (bins, error)
    assert reliability(np.ones(3), np.ones(3, bool)) == (((3, 1.0, 1.0),), 0.0)
    assert math.isnan(reliability(np.zeros(0), np.zeros(0, bool))[1])


def test_trust_counts_what_thresholds_do() -> None:
    calibration = Calibration(samples(1))
    rng = np.random.default_rng(2)
    scores = rng.gamma(1.0, 4.0, (60, 12))
    truth = np.zeros((60, 12), bool)
    truth[np.arange(40), rng.integers(0, 12, 40)] = True
    truth[np.arange(20), scores[:20].argmax(axis=1)] = True
    answers, together = answers_of("contrast", scores, calibration), Together(calibration=calibration)
    found = trust(answers, truth, together)
    assert found is not None
    assert [row.target for row in found.thresholds] == [0.9, 0.95, 0.98, 0.99]
    assert found.off_map == pytest.approx(20 / 60)
    for row in found.thresholds:
        good = answers.probability >= row.probability
        right = truth[np.arange(60), answers.matches]
        assert row.accepted == pytest.approx(good.mean())
        assert row.kept == pytest.approx((good & right).sum() / 40)
        assert row.false_accepts == pytest.approx(good[40:].mean())
        assert math.isnan(row.precision) if not good.any() else row.precision == pytest.approx(right[good].mean())
    assert found.as_json()["expected_calibration_error"] == found.error


def test_a_filtered_answer_is_right_one_place_beside() -> None:
    truth = np.eye(5, dtype=bool)
    answers = Answers(np.array([1, 0, 2, 3, 2]), np.ones(5), np.full(5, 0.999))
    calibration = Calibration(np.array([[9, RIGHT], [1, OFF_MAP]], np.float32))
    hows = (Together(calibration=calibration), Together(motion="any"))
    alone, near = (trust(answers, truth, together) for together in hows)
    assert alone is not None
    assert near is not None
    assert near.thresholds[-1].precision == pytest.approx(4 / 5)
    assert alone.bins[0].right == pytest.approx(2 / 5)
