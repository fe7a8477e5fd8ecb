"""Gains of inputs as a Lava Process: activity times gain, bit for bit the host's, in every arithmetic."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
from numpy.typing import NDArray
from support.lava.small_networks import FIXED, FLOAT, Runs, hold_in_lava, random_drive, random_network

from lava_vpr.engine.gains import FULL, Digits, digits_of
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.errors import NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.processes.input_gains.process import InputGains
from lava_vpr.synthetic.world import World, render

pytestmark = pytest.mark.lava
JOBS = ("composed", "library")
ALL = [(job, tag) for job in JOBS for tag in ("fixed_pt", "floating_pt")]
INPUTS = 40
RATES = ("plain", "rates")
TINY = FrontEnd(8, budget=12)


def activity(n: int) -> NDArray[np.float32]:
    """Of every size, some of it 0, and more than a digit holds."""
    rng = np.random.default_rng(n)
    values = (rng.random((n, INPUTS)) ** 6 * 4).astype(np.float32)
    values[rng.random(values.shape) < 0.2] = 0
    values[0, :4] = 1e-42, 3e-30, 1e30, 4095.75
    return values


def gains(epochs: int) -> NDArray[np.uint8]:
    """None to all."""
    return np.random.default_rng(epochs).integers(0, FULL + 1, (epochs, INPUTS)).astype(np.uint8)


def in_lava(
    job: str, tag: str, digits: NDArray[np.uint16], known: NDArray[np.uint8], epoch: NDArray[np.int32]
) -> NDArray[np.int64]:
    """The products of digits and gains."""
    arrays = {"digits": digits, "gains": known, "epoch": epoch}
    return run_isolated(f"lava_vpr.processes.jobs.gains:{job}", arrays, {"tag": tag}, timeout=200)["gained"]


def literal(digits: list[list[int]], row: list[int]) -> list[list[int]]:
    """A synapse and a neuron of each input, step by step: 4 of 8 bits of a weight, a sum shifted back, a membrane."""
    made = []
    for sent in digits:
        neurons, arriving = [0] * len(row), [0] * len(row)
        for step in range(2):
            current = [sum_ << 6 for sum_ in arriving]
            neurons = [v + u if step else u for v, u in zip(neurons, current, strict=True)]
            now = sent if step == 0 else [0] * len(row)
            arriving = [number * (gain << 4) >> 4 for number, gain in zip(now, row, strict=True)]
        made.append([v >> 6 for v in neurons])
    return made


@pytest.mark.parametrize(("job", "tag"), ALL)
def test_products_are_the_hosts_to_the_last_bit(job: str, tag: str) -> None:
    values, known, epoch = activity(5), gains(2), np.array([0, 0, 1, 0, 1], np.int32)
    whole = digits_of(values)
    gained = in_lava(job, tag, whole.digits, known, epoch)
    assert whole.digits.shape == (5, 2, INPUTS)
    assert [
        literal(digits.tolist(), known[own].tolist()) for digits, own in zip(whole.digits, epoch, strict=True)
    ] == gained.tolist()
    expected = values * known[epoch].astype(np.float32)
    assert np.array_equal(whole.activity(gained), expected)
    assert (expected != values).any(axis=1).all()


@pytest.mark.parametrize("job", JOBS)
def test_the_cells_of_a_front_end_send_spikes_to_gains(job: str) -> None:
    grey = np.array([TINY.seen(render(World(0), place, "summer")) for place in range(2)])
    row = np.random.default_rng(0).integers(0, FULL + 1, TINY.populations["cells"]).astype(np.uint8)
    options = {"spec": asdict(TINY), "library": job == "library"}
    target = "support.lava.process_targets:front_end_under_gains"
    gained = run_isolated(target, {"grey": grey, "gains": row}, options, timeout=300)["gained"]
    counts = TINY.trains(grey)["cells"].sum(axis=1, dtype=np.int64)
    assert (counts > 1).any(axis=1).all()
    assert np.array_equal(gained, counts * row)


def hold_under_gains(seeds: range, runs: Runs, n: int) -> tuple[int, int]:
    """Random networks in Lava, ``n`` presentations under random gains, from activity to spikes; how many products and
    spikes are equal."""
    cases = {}
    for seed in seeds:
        ways = {"signed": seed % 3 > 0, "regular": seed % 4 > 0, "bias_input": seed % 4 == 2}
        network = random_network(1 + seed % 7, seed, **ways)
        cases[f"n{seed}"] = network, random_drive(network, seed, n), runs
    got = hold_in_lava(cases)
    for network, shown, _ in cases.values():
        plain, under = (count_spikes(network, shown[name], shown["keys"], bias=shown["biases"])[0] for name in RATES)
        assert (plain != under).any()
    spikes = sum(int(got[f"{name}_composed_fixed_pt_{which}"].sum()) for name in cases for which in ("exc", "inputs"))
    return sum(shown["digits"].size for _, shown, _ in cases.values()), spikes


def test_a_random_network_under_random_gains_is_the_hosts() -> None:
    products, spikes = hold_under_gains(range(1), FIXED[1:], 2)
    assert products == 2 * 2 * 49
    assert spikes > 100


@pytest.mark.slow
def test_many_random_networks_under_random_gains_are_the_hosts(capsys: pytest.CaptureFixture[str]) -> None:
    found = [hold_under_gains(range(first, first + 4), FIXED + FLOAT, 4) for first in range(2, 26, 4)]
    products, spikes = (sum(numbers) for numbers in zip(*found, strict=True))
    with capsys.disabled():
        print(f"\n{4 * len(found)} networks under gains, {products:,} products, {spikes:,} spikes")
    assert spikes > 10_000


def test_activity_is_its_digits() -> None:
    values = np.append(activity(3), np.full((3, 1), np.nextafter(np.float32(4096), np.float32(0))), axis=1)
    whole = digits_of(values)
    assert whole.digits.max() < 1 << 12
    assert np.array_equal(whole.activity(whole.digits.astype(np.int64)), values)
    counts = np.array([[0, 15, 4095]], np.float32)
    assert digits_of(counts).digits.tolist() == [[[0, 15, 4095]]]
    assert digits_of(counts + 1).digits.shape == (1, 2, 3)


def test_what_ends_between_two_numbers_is_rounded_once() -> None:
    """Products of 28 bits that lie between numbers of 24 bits, half-way too."""
    values = np.float32(2**23 + 1 + np.arange(60))[None] * np.float32(2.0**-30)
    whole = digits_of(values)
    for gain in range(FULL + 1):
        gained = whole.digits.astype(np.int64) * gain
        assert np.array_equal(whole.activity(gained), values * np.float32(gain))
    halfway = Digits(np.zeros((1, 2, 1), np.uint16), np.zeros((1, 1), np.int32))
    ends = np.array([[[1 << 13], [1]], [[1 << 13], [3]]], np.int64)
    assert halfway.activity(ends[:1]).tolist() == [[2.0**25]]
    assert halfway.activity(ends[1:]).tolist() == [[2.0**25 + 4]]


@pytest.mark.parametrize(
    ("row", "interval", "words"),
    [
        ([3, 16], 2, "InputGains: a gain is 16, but must be whole, in 0..15"),
        ([-1, 3], 2, "InputGains: a gain is -1, but must be whole"),
        ([0.5, 3], 2, "InputGains: a gain is 0.5, but must be whole"),
        ([[1, 3]], 2, "InputGains: gains: shape is (1, 2), but must be (neurons,)"),
        ([1, 3], 1, "InputGains: interval is 1, but must be a whole number, at least 2"),
    ],
)
def test_gains_that_cannot_be_are_refused(row: list[float], interval: int, words: str) -> None:
    with pytest.raises(NetworkLimitError) as caught:
        InputGains(gains=np.array(row), interval=interval)
    assert words in str(caught.value)
