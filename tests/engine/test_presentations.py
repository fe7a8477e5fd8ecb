"""Compiled code is never given arrays whose ends it would run past, whoever calls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.common.small_models import tiny_paper

from lava_vpr.config import StdpLearning
from lava_vpr.engine.conductance import model as conductance
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.membranes import membranes
from lava_vpr.engine.learning import integer, lava_order, stdp
from lava_vpr.engine.learning.integer_kernels import StepDraws
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.inputs.orientation import orientation_channels

INPUTS, NEURONS, STEPS = 20, 3, 12
WEIGHTS = np.ones((INPUTS, NEURONS), np.uint8)
NETWORK = FixedNetwork(WEIGHTS.astype(np.int16), np.zeros(NEURONS, np.int32), 3, False, 10, 5, 0, 100, STEPS)
RATES, KEYS = np.ones((2, INPUTS), np.uint16), np.arange(2, dtype=np.uint64)
LEARNING = StdpLearning(steps=STEPS)
PAPER = tiny_paper()
THRESHOLDS = np.ones(NEURONS, np.int32)
RATES32 = np.ones((2, INPUTS), np.uint32)
SPIKES = np.zeros((STEPS + 3, INPUTS), np.uint8)


def reals(rates: np.ndarray = RATES[0]) -> object:
    state = stdp.initial_state(INPUTS, NEURONS, LEARNING, 5.0, 0, 0)
    return stdp.present(state, stdp.phases(LEARNING, INPUTS, 5.0)[0], rates, 1)


def integers(rates: np.ndarray = RATES[0], theta: np.ndarray | None = None, **options: Any) -> object:
    phase = integer.phases(LEARNING, INPUTS, 5.0)[0]
    theta = np.full(NEURONS, 50, np.int32) if theta is None else theta
    return integer.present(stdp.PlasticState(WEIGHTS.copy(), theta), phase, rates, 1, **options)


def floats(**changes: np.ndarray) -> conductance.ConductanceState:
    shape = (INPUTS, NEURONS)
    state = conductance.ConductanceState(np.ones(shape), np.full(NEURONS, 20.0), np.zeros(shape, np.uint16))
    return replace(state, **changes)


ENTRIES: dict[str, Callable[..., object]] = {
    "fixed": lambda rates=RATES, keys=KEYS, **options: count_spikes(NETWORK, rates, keys, **options),
    "stdp": reals,
    "integer": integers,
    "fold": lambda w=WEIGHTS, t=THRESHOLDS: lava_order.fold(w, t, 1, 1),
    "membranes": lambda i=SPIKES, inh=SPIKES[:, :1]: membranes(NETWORK, i, inh),
    "float": lambda r=RATES32, k=KEYS, **state: conductance.count_spikes(floats(**state), r, k, PAPER),
    "float training": lambda r=RATES32[0], **state: conductance.train_presentation(floats(**state), r, 1, PAPER),
}


@pytest.mark.parametrize("entry", ENTRIES)
def test_what_fits_is_taken(entry: str) -> None:
    ENTRIES[entry]()


DRAWS = StepDraws(np.zeros(STEPS + 2, np.uint64), np.zeros(STEPS + 3, np.uint64))


@pytest.mark.parametrize(
    ("entry", "arguments"),
    [
        *(("fixed", (RATES[:, :n],)) for n in (0, INPUTS - 1)),
        ("fixed", (np.ones((2, INPUTS + 5), np.uint16),)),
        ("fixed", (RATES[0],)),
        ("fixed", (RATES.astype(np.int64),)),
        ("fixed", (RATES / 2,)),
        ("fixed", (RATES, KEYS[:1])),
        ("fixed", (RATES, KEYS.astype(np.int64))),
        ("fixed", (RATES, np.ones((2, 2), np.uint64))),
        ("fixed", {"bias": np.zeros((1, NEURONS), np.int32)}),
        ("fixed", {"bias": np.zeros((2, NEURONS + 1), np.int32)}),
        ("fixed", {"bias": np.zeros(NEURONS, np.int32)}),
        ("fixed", {"bias": np.zeros((2, NEURONS), np.int64)}),
        ("stdp", (np.ones(INPUTS + 5, np.uint16),)),
        ("stdp", (RATES,)),
        ("stdp", (RATES[0].astype(np.int64),)),
        ("integer", (np.ones(INPUTS + 5, np.uint16),)),
        ("integer", (RATES[0], np.ones(NEURONS - 1, np.int32))),
        ("integer", {"traces": np.zeros(INPUTS - 1, np.uint8)}),
        ("integer", {"traces": np.full(INPUTS, 128, np.uint8)}),
        ("integer", {"inhibition": np.zeros(NEURONS - 1, np.int64)}),
        ("integer", {"draws": DRAWS}),
        ("fold", (WEIGHTS, np.ones(NEURONS + 1, np.int32))),
        ("fold", (WEIGHTS, np.zeros(NEURONS, np.int32))),
        ("fold", (WEIGHTS.astype(np.int64),)),
        ("membranes", (SPIKES[:, :-1],)),
        ("membranes", (SPIKES, SPIKES)),
        ("membranes", (SPIKES, SPIKES[1:, :1])),
        ("float", (RATES32[:, :-1],)),
        ("float", (RATES32[0],)),
        ("float", (RATES,)),
        ("float", (RATES32, KEYS[:1])),
        ("float", {"delays": np.full((INPUTS, NEURONS), -7, np.int16)}),
        ("float", {"delays": np.zeros((INPUTS, 1), np.uint16)}),
        ("float", {"theta_mv": np.ones(NEURONS + 1)}),
        ("float training", (np.ones(INPUTS + 5, np.uint32),)),
        ("float training", (RATES[0],)),
    ],
)
def test_what_does_not_fit_is_refused(entry: str, arguments: tuple[Any, ...] | dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        ENTRIES[entry](**arguments) if isinstance(arguments, dict) else ENTRIES[entry](*arguments)
    assert "; " in str(caught.value)
    assert str(caught.value).isprintable()


def test_a_grid_that_its_cells_do_not_fill_is_refused() -> None:
    with pytest.raises(ConfigError, match="56 pixels is no multiple of the cell of 5"):
        orientation_channels(np.zeros((60, 60), np.uint8), 56, 5)
