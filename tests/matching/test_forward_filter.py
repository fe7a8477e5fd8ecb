"""The forward filter, beside a literal hidden Markov model written as one matrix, and on drives of every sort."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest
from numpy.typing import NDArray
from support.literal.tracks import QUARTERS, between, literal

from lava_vpr.errors import ConfigError, InputError
from lava_vpr.matching.answers import Answerer, Together
from lava_vpr.matching.beliefs import Beliefs, filtered
from lava_vpr.matching.decoders import margin
from lava_vpr.matching.forward_filter import ForwardFilter, evidence
from lava_vpr.matching.probability import OFF_MAP, RIGHT, WRONG, Calibration
from lava_vpr.matching.smoothing import smooth

PLACES = 60


def calibration() -> Calibration:
    """One by which small margins are often wrong and large ones right."""
    rng = np.random.default_rng(5)
    kinds = np.repeat([RIGHT, WRONG, OFF_MAP], 200)
    return Calibration(np.stack([rng.gamma(2.0, 1.0, 600) + 3.0 * (kinds == RIGHT), kinds], axis=1).astype(np.float32))


def drawn(seed: int, queries: int = 12, n: int = 9) -> NDArray[np.float64]:
    """Scores without any order, one query without a spike."""
    scores = np.random.default_rng(seed).gamma(0.4, 4.0, (queries, n))
    scores[3] = 0.0
    return scores


@pytest.mark.parametrize("motion", QUARTERS)
@pytest.mark.parametrize("n", [5, 9])
def test_the_filter_is_the_markov_model(motion: str, n: int) -> None:
    scores, known = drawn(n, n=n), calibration()
    model = literal(scores, motion, known)
    assert model.moves.sum(axis=1) == pytest.approx(np.ones(len(model.moves)))
    start, moving = ForwardFilter.start(n, motion, known), np.ones(len(scores), bool)
    _, beliefs = filtered(start, scores, moving)
    for number, state in enumerate(model.states):
        tracks, alone, off_map = model.places(number, state)
        hidden = model.hidden[number]
        np.testing.assert_allclose(beliefs.places[number], (1 - hidden / 2) * tracks + alone, rtol=1e-9, atol=1e-14)
        sure = (1 - hidden) * tracks + alone
        np.testing.assert_allclose(beliefs.sure[number], sure, rtol=1e-9, atol=1e-14)
        assert beliefs.off_map[number] == pytest.approx(off_map + hidden / 2 * tracks.sum(), rel=1e-9, abs=1e-14)
        assert beliefs.followed[number] == pytest.approx((1 - hidden) * tracks.sum(), abs=1e-12)


@pytest.mark.parametrize(("n", "peak"), [(50, 15.0), (100, 30.0), (200, 30.0)])
def test_evidence_by_hand(n: int, peak: float) -> None:
    scores = np.zeros(n)
    scores[[3, 7]] = [3.0, 1.0]
    wanted = np.full(n, 0.2)
    wanted[[3, 7]] += np.array([0.9, 0.1]) * peak
    np.testing.assert_allclose(evidence(scores), wanted)
    assert np.array_equal(evidence(np.zeros(n)), np.full(n, 0.2))


@pytest.mark.parametrize("motion", QUARTERS)
@pytest.mark.parametrize("cuts", [[], [5], [1, 4]])
def test_smoothing_is_that_of_the_markov_model(motion: str, cuts: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lava_vpr.matching.smoothing._KEPT", 3)
    n, known = 6, calibration()
    scores = drawn(1, n=n)
    model, later = literal(scores, motion, known), np.ones((24 * len(QUARTERS[motion])) + n + 1)
    wanted = []
    for number in range(len(scores) - 1, -1, -1):
        both = model.states[number] * later
        wanted.append(model.places(number, both / both.sum()))
        single = model.single[number]
        rest = (single * later[-n - 1 : -1]).sum() + (1 - single.sum()) * later[-1]
        said = np.concatenate([np.tile(between(model.likely[number]), len(QUARTERS[motion])), np.ones(n + 1)])
        after = later * said
        after[-1] = rest
        later = model.moves @ after
        later = later / later.max()
    state, starts = ForwardFilter.start(n, motion, known), []
    for some in np.split(scores, cuts):
        starts.append(state)
        state, _ = filtered(state, some)
    told, found = None, list[Beliefs]()
    for begin, some in zip(reversed(starts), reversed(np.split(scores, cuts)), strict=True):
        beliefs, told = smooth(begin, some, np.ones(len(some), bool), told)
        found.append(beliefs)
    places, off_map = np.concatenate([one.places for one in found[::-1]]), [one.off_map for one in found[::-1]]
    np.testing.assert_allclose(places, [tracks + alone for tracks, alone, _ in wanted[::-1]], rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(np.concatenate(off_map), [off for _, _, off in wanted[::-1]], rtol=1e-8, atol=1e-14)


def world(seed: int, place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Scores of queries at these places (-1: off the map), two in ten of which look like another place."""
    rng = np.random.default_rng(seed)
    looks = np.round(rng.gamma(1.0, 1.2, (PLACES, PLACES)))
    fooled = rng.random(PLACES) < 0.2
    looks[np.arange(PLACES), np.where(fooled, rng.integers(0, PLACES, PLACES), np.arange(PLACES))] += 12
    looks[np.arange(PLACES), np.arange(PLACES)] += 3
    nowhere = np.round(rng.gamma(1.0, 1.2, (len(place), PLACES)))
    return np.where(place[:, None] >= 0, looks[place], nowhere)


def of_world() -> Calibration:
    """One of what the world above shows: altered places, and what is nowhere."""
    on, off = world(11, np.arange(PLACES)), world(12, np.full(PLACES, -1))
    kinds = np.where(on.argmax(axis=1) == np.arange(PLACES), RIGHT, WRONG)
    samples = np.concatenate([np.stack([margin(on), kinds], 1), np.stack([margin(off), np.full(PLACES, OFF_MAP)], 1)])
    return Calibration(samples.astype(np.float32))


DRIVES = {
    "at half the speed": np.repeat(np.arange(PLACES), 2),
    "at the same speed": np.arange(PLACES),
    "1.5 times as fast": (np.arange(PLACES // 1.5) * 1.5).astype(np.int64),
    "twice as fast": np.arange(0, PLACES, 2),
    "three times as fast": np.arange(0, PLACES, 3),
    "five times as fast": np.arange(0, PLACES, 5),
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
    _, beliefs = filtered(ForwardFilter.start(PLACES, "any", of_world()), scores, moving)
    places, chance = beliefs.best()
    near = np.abs(places - truth) <= 1
    assert near.mean() > max(alone, 0.9)
    assert (near | (chance < 0.95)).mean() > 0.98
    assert chance[len(truth) // 2 :].mean() > 0.8


def test_who_is_carried_off_is_found_again() -> None:
    truth = np.concatenate([np.arange(5, 25), np.arange(40, 52)])
    places, _ = filtered(ForwardFilter.start(PLACES, "any", of_world()), world(2, truth))[1].best()
    assert np.array_equal(places[-4:], truth[-4:])


def test_off_the_map_is_an_answer() -> None:
    """Who was never followed is off it; after a drive, this may as well be a stretch of which nothing is seen."""
    _, beliefs = filtered(ForwardFilter.start(PLACES, "any", of_world()), world(3, np.full(25, -1)))
    assert beliefs.off_map[:20].min() > 0.8
    assert beliefs.off_map.min() > 0.6
    truth = np.concatenate([np.arange(10, 40), np.full(25, -1)])
    _, beliefs = filtered(ForwardFilter.start(PLACES, "any", of_world()), world(3, truth))
    assert beliefs.off_map[-20:].min() > 0.45
    assert beliefs.off_map[10:30].max() < 0.3
    assert beliefs.best()[1][-10:].max() < 0.1


def sharp(place: NDArray[np.int64], other: float = 1.0) -> NDArray[np.float64]:
    """Scores of queries that show their places plainly: 12 there, and less than ``other`` elsewhere."""
    scores = np.random.default_rng(7).uniform(0.0, other, (len(place), PLACES))
    scores[np.arange(len(place)), place] = 12.0
    return scores


@pytest.mark.parametrize("off_map", [0.5, 0.9])
def test_the_first_query_and_any_order_are_answered_as_single_ones(off_map: float) -> None:
    truth, known = np.random.default_rng(1).permutation(PLACES), calibration()
    scores = sharp(truth, 6.0)
    beliefs = filtered(ForwardFilter.start(PLACES, "any", known, off_map=off_map), scores)[1]
    places, chance = beliefs.best()
    single = known.probabilities(scores, off_map)
    assert np.array_equal(places, truth)
    assert beliefs.places[0, truth[0]] == pytest.approx(single[0], abs=1e-9)  # and so near it, it is a little more
    assert single[0] <= chance[0] < 1.0
    assert np.abs(chance - single).max() < 0.11
    assert np.median(beliefs.followed) < 0.1


def test_too_fast_is_neither_off_the_map_nor_followed() -> None:
    truth, known = (np.arange(40) * 17) % PLACES, calibration()
    _, beliefs = filtered(ForwardFilter.start(PLACES, "any", known), sharp(truth))
    places, chance = beliefs.best()
    assert np.array_equal(places, truth)
    assert chance.min() > 0.9
    assert beliefs.followed.max() < 0.2
    assert beliefs.off_map.max() < 0.1


def test_a_dull_stretch_neither_ends_the_track_nor_adds_up() -> None:
    """Twenty queries that all look a little like place 5; then the drive goes on where it would be."""
    truth = np.arange(PLACES)
    scores, dull = sharp(truth), slice(20, 40)
    scores[dull] = np.random.default_rng(2).uniform(8.0, 9.0, (20, PLACES))
    scores[dull, 5] = 9.5
    _, beliefs = filtered(ForwardFilter.start(PLACES, "any", calibration()), scores)
    places, chance = beliefs.best()
    assert np.abs(places - truth).max() <= 1
    assert chance[25:40].max() < 0.5
    assert chance[42:].min() > 0.9
    assert beliefs.off_map[25:40].max() < 0.6
    assert beliefs.followed[25:40].max() < 0.2
    assert beliefs.followed[45:].min() > 0.9


def test_standing_still_is_no_news() -> None:
    state = ForwardFilter.start(5)
    scores = np.array([1.0, 4, 0, 0, 0])
    first = state.update(scores, moving=False)
    assert first.alone.argmax() == 1
    assert first.update(np.array([0.0, 0, 0, 9, 0]), moving=False) is first


def followed_at(place: int, n: int, motion: str, along: NDArray[np.float64]) -> ForwardFilter:
    """The state of who is surely followed at a place, at one place a query, either way with motion any."""
    state = ForwardFilter.start(n, motion, None, along)
    shifts = QUARTERS[motion]
    for shift in (-4, 4) if motion == "any" else (4,):
        state.tracks[shifts.index(shift), 4 * place] = 0.5 if motion == "any" else 1.0
    return dataclasses.replace(state, positions=state.tracks.sum(axis=0), lost=1e-15, alone=np.zeros(n), begun=True)


@pytest.mark.parametrize(("motion", "ahead", "back"), [("forward", 1.0, 0.0), ("any", 0.5, 0.5)])
def test_odometry_by_hand(motion: str, ahead: float, back: float) -> None:
    """30 m from place 5 of places 10 m apart: a quarter each to 3 places less and more a tenth, half to 3; blurred.

    A tenth is 0.3 places, of which 0.2 go to the quarter beside it, and 0.8 to the next.
    """
    bump = {-2: 0.05, -1: 0.2, 0: 0.5, 1: 0.2, 2: 0.05}  # quarters from where 30 m lead
    wanted = np.zeros(44)
    for way, share in ((1, ahead), (-1, back)):
        for off, part in bump.items():
            for place, blur in ((-1, 0.25), (0, 0.5), (1, 0.25)):
                wanted[20 + way * (12 + off) + 4 * place] += 0.99 * share * part * blur
    state = followed_at(5, 11, motion, 10.0 * np.arange(11))
    for metres in (30.0,) if motion == "forward" else (30.0, -30.0):
        moved = state.moved(metres)
        np.testing.assert_allclose(moved.positions, wanted, rtol=1e-9, atol=1e-15)
        speed = np.array(QUARTERS[motion])[moved.tracks.sum(axis=1).argmax()]
        assert abs(speed) == 12
    assert state.moved(0.0).positions[[16, 20, 24]] == pytest.approx(0.99 * np.array([0.25, 0.5, 0.25]))


def test_an_odometer_moves_what_stands_still() -> None:
    state = followed_at(1, 10, "forward", np.arange(10.0))
    moved = state.update(np.ones(10), moving=False, odometry=3.0)
    np.testing.assert_array_equal(moved.positions, state.moved(3.0).positions)
    assert state.update(np.ones(10), moving=False, odometry=0.0) is state


def test_odometry_over_an_end_is_followed_no_more() -> None:
    along = np.cumsum(np.array([0.0, 5, 5, 20, 5, 5, 5, 30, 5, 5]))
    state = followed_at(1, 10, "forward", along)
    assert state.moved(25.0).positions.argmax() == 12
    gone = state.moved(500.0)
    assert gone.lost == pytest.approx(1.0)


def test_stamps_say_how_far() -> None:
    """Images are lost here and there, and of the last few nothing is seen; stamps tell how far tracks went on."""
    truth = np.flatnonzero(np.random.default_rng(4).random(PLACES) < 0.5)[:18]
    scores = np.full((len(truth), PLACES), 1.0) + sharp(truth, 0.2) * (np.arange(len(truth)) < 12)[:, None]
    start, apart = ForwardFilter.start(PLACES, "forward", calibration()), []
    for stamps in (10.0 + 0.5 * truth, None):
        apart.append(np.abs(filtered(start, scores, stamps=stamps)[1].best()[0] - truth))
    assert (apart[0][:12].max(), apart[1][:12].max()) == (0, 3)
    assert apart[0][12:].mean() < 0.6 * apart[1][12:].mean()


@pytest.mark.parametrize("odd", [float("nan"), float("inf"), 3.0, 7.0])
def test_stamps_that_make_no_sense_change_nothing(odd: float) -> None:
    scores = drawn(2, n=9)
    stamps = np.arange(7.0, 7.0 + len(scores))
    usual = filtered(ForwardFilter.start(9), scores[:4], stamps=stamps[:4])[0]
    states = [usual.update(scores[5], stamp=stamp) for stamp in (odd, 11.0)]
    np.testing.assert_array_equal(states[0].tracks, states[1].tracks)
    assert states[0].interval == states[1].interval


def test_queries_of_which_nothing_is_likely_leave_the_filter_alive() -> None:
    """Where nearly all is off the map, the probabilities of small margins are 0: then no place is believed at all."""
    known = Calibration(np.array([[9, RIGHT]] * 20 + [[1, WRONG]] * 5 + [[1, OFF_MAP]] * 25, np.float32))
    scores, off_map = np.ones((3, 9)), 1 - 1e-9
    assert not known.probabilities(scores, off_map).any()
    _, beliefs = filtered(ForwardFilter.start(9, "any", known, None, off_map), scores)
    np.testing.assert_array_equal(beliefs.off_map, 1.0)


@pytest.mark.parametrize("odd", [0.0, float("nan")])
def test_one_odd_stamp_sends_nobody_far(odd: float) -> None:
    """Each of these ten queries is one interval after the last, whatever the ninth stamp says."""
    stamps = np.append(np.arange(7.0, 15.0), [odd, 16.0])
    scores, start = np.resize(drawn(2), (10, 9)), ForwardFilter.start(9)
    odd_one, none = (filtered(start, scores, stamps=some)[0] for some in (stamps, None))
    np.testing.assert_array_equal(odd_one.tracks, none.tracks)


def test_a_changed_map_keeps_what_is_believed_of_its_places() -> None:
    truth = np.arange(30)
    state, _ = filtered(ForwardFilter.start(PLACES, "any", calibration()), sharp(truth))
    kept = np.append(np.arange(10, PLACES), -1)
    changed = state.remapped(kept, None)
    beliefs = [Beliefs.empty(1, len(one.alone)) for one in (state, changed)]
    for one, of in zip(beliefs, (state, changed), strict=True):
        one.put(0, of)
    np.testing.assert_allclose(beliefs[1].places[0, 1:-2], beliefs[0].places[0, 11:-1], rtol=1e-6)
    assert beliefs[1].places[0, -1] < 1e-9
    lost = float(beliefs[0].places[0, :10].sum())
    assert beliefs[1].off_map[0] == pytest.approx(beliefs[0].off_map[0] + lost, abs=1e-10)
    assert pickle.loads(pickle.dumps(changed)).moved().lost == pytest.approx(changed.moved().lost)


def test_what_makes_no_sense_is_refused() -> None:
    state = ForwardFilter.start(4)
    with pytest.raises(InputError, match=r"scores of shape \(3,\) for 4 places"):
        state.update(np.ones(3))
    with pytest.raises(InputError, match="odometry needs a map with positions"):
        state.update(np.ones(4), odometry=1.0)
    with pytest.raises(InputError, match="finite number of metres"):
        ForwardFilter.start(4, "any", None, np.arange(4.0)).update(np.ones(4), odometry=float("nan"))
    with pytest.raises(ConfigError, match="there is no motion 'sideways'; choose from any, forward, none"):
        Together(motion="sideways")
    with pytest.raises(ConfigError, match="both look back"):
        Together(sequence=5, motion="any")


@pytest.mark.parametrize("cuts", [[], [1], [4, 5, 9]])
def test_a_stream_is_followed_in_any_parts(cuts: list[int]) -> None:
    scores, moving = drawn(1), np.random.default_rng(0).random(12) < 0.7
    places, chance = filtered(ForwardFilter.start(9), scores, moving)[1].best()
    state, found = Answerer.of("contrast", 9, Together(motion="any")), []
    for some, moves in zip(np.split(scores, cuts), np.split(moving, cuts), strict=True):
        state, answers = state.step(some, moves)
        found.append(answers)
    assert np.array_equal(np.concatenate([answers.matches for answers in found]), places)
    assert np.concatenate([answers.probability for answers in found]) == pytest.approx(chance, abs=1e-8)
