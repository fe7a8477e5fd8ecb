"""Gains learned from sure answers: against their definition in plain numbers, and what must teach nothing."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.small_models import encoded, small_model
from support.literal.season import Drive, Told

from lava_vpr.backends.asking import Asker, Asking
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine import gains
from lava_vpr.engine.gains import FULL, Reference, Season, gains_of, weighed
from lava_vpr.inputs.doubts import Sign
from lava_vpr.matching.answers import Answers
from lava_vpr.model import integer_model
from lava_vpr.season.file import unlearned

TAU, QUERIES = 7.0, 40
NOTHING = [Sign()] * 60
LEARNING = Asking(adapt=TAU, learn=True)


def drive(n: int = QUERIES) -> EncodedTraverse:
    """Images of the map's places, again and again, in which half of the inputs show something else."""
    rng, known = np.random.default_rng(1), small_model().activity
    other = rng.random((n, known.shape[1])).astype(np.float32) ** 6
    lasting = np.arange(known.shape[1]) % 2 == 0
    activity = np.where(lasting, known[np.arange(n) % len(known)], other)
    return dataclasses.replace(encoded(n), activity=activity, patches=None, thumbnails=None, hog=None)


def told(n: int, seed: int = 2, *, tracked: bool = False) -> Answers:
    """Answers of all sorts to `drive`."""
    rng = np.random.default_rng(seed)
    places = np.where(rng.random(n) < 0.1, -1, np.arange(n) % 8)
    off_map = np.zeros(n) if tracked else None
    return Answers(places, rng.random(n).round(2), rng.choice([0.2, 0.7, 0.949, 0.95, 1.0, np.nan], n), off_map)


def part(answers: Answers, rows: slice) -> Answers:
    """Some of the answers."""
    off_map = None if answers.off_map is None else answers.off_map[rows]
    return Answers(answers.matches[rows], answers.confidence[rows], answers.probability[rows], off_map)


Seen = list[tuple[list[int], list[int], list[int]]]


def literal(asked: EncodedTraverse, answers: Answers) -> tuple[Seen, list[bool], Drive]:
    """What the literal drive shows and is taught, and what it knows at the end."""
    model = integer_model(small_model(), "a test")
    network, encoder = model.network, model.config.encoder
    slow = Drive(
        weights=network.weights.astype(int).tolist(),
        own=network.bias.tolist(),
        safe=network.safe_bias,
        references=model.activity.tolist(),
        most=encoder.query_inputs,
        spikes=encoder.query_spikes,
        tau=TAU,
        epoch=gains.EPOCH,
        remembered=gains.MARGINS,
        recent=gains.RECENT,
        enough=gains.ENOUGH,
    )
    seen, taught = [], []
    for i, row in enumerate(asked.activity.tolist()):
        seen.append(slow.see(row))
        place, confidence, probability = (values[i].item() for values in answers[:3])
        taught.append(slow.hear(Told(place, probability, confidence, answers.off_map is not None)))
    return seen, taught, slow


@pytest.mark.parametrize("tracked", [False, True])
def test_a_drive_is_the_literal_one(monkeypatch: pytest.MonkeyPatch, tracked: bool) -> None:
    for name, value in {"EPOCH": 4, "MARGINS": 9, "RECENT": 7, "ENOUGH": 2}.items():
        monkeypatch.setattr(gains, name, value)
    asked, answers, asker = drive(), told(QUERIES, tracked=tracked), Asker(small_model(), LEARNING)
    seen, taught, slow = literal(asked, answers)
    start, sizes = 0, []
    for _, shown in asker.in_turn([(asked,)]):
        rows = slice(start, start + len(shown.rates))
        for row, found in zip(seen[rows], zip(shown.seen, shown.rates, shown.bias, strict=True), strict=True):
            assert [values.tolist() for values in found] == list(row)
        some = part(answers, rows)
        assert asker.learn(some, NOTHING[: len(shown.rates)]).tolist() == taught[rows]
        start, sizes = rows.stop, [*sizes, len(shown.rates)]
    season = asker.learner.season
    assert start == QUERIES
    assert season.gains.tolist() == slow.gains
    assert season.sums.T.tolist() == slow.sums
    assert season.taught == sum(taught) > gains.EPOCH
    assert max(sizes) <= 4
    assert min(sizes) < 4


def test_what_lasts_is_trusted_and_what_changes_is_not() -> None:
    n, asker = 60, Asker(small_model(), LEARNING)
    sure = Answers(np.arange(n) % 8, np.ones(n), np.ones(n))
    start = 0
    for _, shown in asker.in_turn([(drive(n),)]):
        rows = slice(start, start := start + len(shown.rates))
        asker.learn(part(sure, rows), NOTHING[: len(shown.rates)])
    learned = asker.learner.season.gains.astype(float)
    assert learned[::2].mean() > learned[1::2].mean() + 4
    assert asker.learner.season.answered == n
    assert asker.learner.season.taught == n - gains.ENOUGH + 1


def test_gains_of_one_change_nothing() -> None:
    asked = drive()
    plain = Asker(small_model(), Asking(adapt=TAU)).presentations((asked,))
    learning = Asker(small_model(), LEARNING).presentations((asked,))
    assert learning.plain is None
    assert np.array_equal(learning.rates, plain.rates)
    assert np.array_equal(learning.bias, plain.bias)
    assert np.array_equal(learning.keys, plain.keys)


def test_noise_is_the_image_s_own_under_any_gains() -> None:
    asked = drive(3)
    season = Asker(small_model(), LEARNING).learner.season
    half = dataclasses.replace(season, gains=np.arange(season.gains.size, dtype=np.uint8) % 16)
    plain, under = (Asker(small_model(), how).presentations((asked,)) for how in (Asking(), Asking(season=half)))
    assert (plain.rates != under.rates).any()
    assert np.array_equal(plain.keys, under.keys)
    assert np.array_equal(under.part(slice(1, 3)).keys, plain.keys[1:])
    assert not under.rates[:, half.gains == 0].any()


def taught_by(answers: Answers, asked: EncodedTraverse, *, doubtful: bool = False) -> int:
    """How many of the answers teach."""
    steady = dataclasses.replace(unlearned(integer_model(small_model(), "a test")), sure=np.ones(30, np.uint8))
    asker = Asker(small_model(), dataclasses.replace(LEARNING, season=steady))
    asker.presentations((asked,))
    return int(asker.learn(answers, [Sign(doubtful=doubtful)] * len(asked)).sum())


@pytest.mark.parametrize(
    ("answers", "repeated"),
    [
        (Answers(np.zeros(10, np.int64), np.ones(10), np.full(10, 0.69)), False),
        (Answers(np.zeros(10, np.int64), np.ones(10), np.full(10, 0.94), np.zeros(10)), False),
        (Answers(np.full(10, -1), np.full(10, -np.inf), np.ones(10)), False),
        (Answers(np.zeros(10, np.int64), np.ones(10), np.full(10, np.nan)), False),
        (Answers(np.zeros(10, np.int64), np.ones(10), np.ones(10)), True),
    ],
    ids=["unsure", "unsure filter", "no match", "unknown", "a camera that is stuck"],
)
def test_what_is_not_sure_teaches_nothing(answers: Answers, repeated: bool) -> None:
    asked = drive(10)
    if repeated:
        asked = dataclasses.replace(asked, activity=np.repeat(asked.activity[:1], 10, axis=0))
    assert taught_by(answers, asked) == int(repeated)  # the first of them is new


def test_what_is_doubtful_teaches_nothing() -> None:
    sure = Answers(np.zeros(10, np.int64), np.ones(10), np.ones(10), np.zeros(10))
    assert [taught_by(sure, drive(10), doubtful=against) for against in (False, True)] == [10, 0]


def test_off_the_map_few_answers_are_sure_and_none_teaches() -> None:
    """The sure ones among them are as sure as can be: a quarter of all, after a stretch on the map."""
    asker, n = Asker(small_model(), LEARNING), 200
    chance = np.where((np.arange(n) < 50) | (np.arange(n) % 4 == 0), 1.0, 0.1)
    asker.presentations((drive(n),))
    taught = asker.learn(Answers(np.arange(n) % 8, np.ones(n), chance), [Sign()] * n)
    assert taught[10:50].all()
    assert not taught[80:].any()


def test_weights_of_means_keep_their_sum() -> None:
    rates = np.array([[100, 50, 0, 30], [7, 0, 0, 0], [0, 0, 0, 0]], np.uint16)
    under = weighed(rates, np.array([15, 0, 3, 5], np.uint8))
    assert under.tolist() == [[164, 0, 0, 16], [7, 0, 0, 0], [0, 0, 0, 0]]


def test_old_answers_are_forgotten() -> None:
    """What once agreed, and then does not for 3,000 answers, is trusted no more than what never did."""
    rng = np.random.default_rng(0)
    variance = np.array([1000, 1000])
    season = Season.start(2)
    for i in range(4000):
        matched = rng.integers(-50, 50, 2)
        query = np.array([matched[0] if i < 1000 else -matched[0], -matched[1]])
        season = season.learned(matched, query, variance)
    assert season.gains.tolist() == [0, 0]
    assert (gains_of(np.zeros((3, 2), np.int64), variance) == FULL).all()


def test_the_reference_is_the_mean_and_variance_of_all_blocks() -> None:
    rates: NDArray[np.uint16] = np.random.default_rng(0).integers(0, 4000, (11, 5)).astype(np.uint16)
    rates[:, 4] = 7
    found = Reference.of([rates[:4], rates[4:]])
    assert np.array_equal(found.mean, np.floor(rates.mean(axis=0) + 0.5))
    assert np.allclose(found.variance[:4], rates[:, :4].astype(float).var(axis=0), atol=1.5)
    assert found.variance[4] == 1
