"""What our Processes refuse."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.processes.encoders.process import PoissonEncoder, RegularEncoder
from lava_vpr.processes.lif.process import ExcitatoryLIF, InhibitoryLIF, PyExcitatoryLIFFixed, PyExcitatoryLIFFloat
from lava_vpr.processes.networks.process import FusedPlaceNetwork, PlaceNetwork
from lava_vpr.processes.spike_counter.process import SpikeCounter
from lava_vpr.processes.synapses.process import (
    DenseSynapses,
    LateralInhibition,
    OneToOne,
    PyDenseSynapsesFixed,
    PyDenseSynapsesFloat,
    PyOneToOneFixed,
    PyOneToOneFloat,
)

pytestmark = pytest.mark.lava


def dense(**changes: Any) -> DenseSynapses:
    return DenseSynapses(**{"weights": np.ones((2, 3), int)} | changes)


def lif(**changes: Any) -> ExcitatoryLIF:
    return ExcitatoryLIF(**{"shape": (3,), "dv": 137, "vth": 80} | changes)


PRESENTED = {"rates": np.ones((2, 3), np.uint16), "keys": np.ones(2, np.uint64), "steps": 4, "silent_steps": 3}


def regular(**changes: Any) -> RegularEncoder:
    return RegularEncoder(**PRESENTED | changes)


def encoder(**changes: Any) -> PoissonEncoder:
    return PoissonEncoder(**PRESENTED | changes)


def counter(**changes: Any) -> SpikeCounter:
    return SpikeCounter(**{"shape": (3,), "presentations": 2, "interval": 4} | changes)


def place(weights: NDArray[np.int16], **changes: Any) -> FixedNetwork:
    numbers: dict[str, Any] = {"threshold": 5, "inhibition": 5, "inhibition_exponent": 0, "decay": 137, "steps": 4}
    return FixedNetwork(weights, np.zeros(weights.shape[1], np.int32), 1, False, **numbers | changes)


def fused(**changes: Any) -> FusedPlaceNetwork:
    network = place(np.ones((3, 2), np.int16))
    return FusedPlaceNetwork(
        **{"network": network, "rates": np.ones((2, 3), np.uint16), "keys": np.ones(2, np.uint64)} | changes
    )


REFUSED: list[tuple[Any, dict[str, Any], str]] = [
    (dense, {"weights": np.full((2, 3), 256)}, "excitatory weight is 256, but must be a whole number in 0..255"),
    (dense, {"weights": np.full((2, 3), -256)}, "inhibitory weight is -256"),
    (dense, {"weights": np.array([[300, -1]])}, "mixed weight is 300, but must be a whole number in -256..255"),
    (dense, {"sign_mode": "inhibitory"}, "inhibitory weight is 1"),
    (dense, {"sign_mode": SignMode.NULL, "weights": np.array([[-1]])}, "null weight is -1"),
    (dense, {"sign_mode": "both"}, "sign_mode is 'both', but must be null, mixed"),
    (dense, {"weights": np.ones(3, int)}, "weights are int64 (3,), but must be numbers (post, pre)"),
    (dense, {"weights": np.array([[np.nan]])}, "a weight is nan, but must be finite"),
    (dense, {"num_weight_bits": 9}, "num_weight_bits is 9, but must be in 1..8"),
    (dense, {"weight_exp": -8}, "weight_exp is -8, but must be in -7..7"),
    (dense, {"weight_exp": 0.5}, "weight_exp is 0.5"),
    (lif, {"vth": 1 << 17}, "threshold is 131072, but must be a whole number in 0..131071"),
    (lif, {"vth": np.array([1, -1, 1])}, "threshold is -1"),
    (lif, {"vth": np.ones(2, int)}, "vth has shape (2,), but must be one number or one each: (3,)"),
    (lif, {"vth": float("nan")}, "vth is nan, but must be finite"),
    (lif, {"vth": "high"}, "vth is 'high', but must be a number"),
    (lif, {"du": 4096}, "du is 4096, but must be in 0..4095"),
    (lif, {"dv": -1}, "dv is -1, but must be in 0..4096"),
    (lif, {"floor": 1}, "floor is 1, but must be in -131071..0"),
    (lif, {"hold_steps": -1}, "hold_steps is -1, but must be a whole number, at least 0"),
    (lif, {"reset_interval": 0.5}, "reset_interval is 0.5"),
    (lif, {"theta_plus": 1 << 17}, "theta_plus is 131072"),
    (lif, {"bias_mant": 4096}, "bias mantissa is"),
    (lif, {"bias_exp": 8}, "bias exponent is"),
    (lif, {"shape": (3, 2)}, "ExcitatoryLIF: shape is (3, 2), but must be (neurons,)"),
    (InhibitoryLIF, {"shape": (3,), "vth": -1}, "threshold is -1"),
    (OneToOne, {"shape": (3,), "weight": 256}, "weight is 256, but must be a whole number in -255..255"),
    (OneToOne, {"shape": (), "weight": 1}, "OneToOne: shape is ()"),
    (OneToOne, {"shape": (3,), "weight": 1, "weight_exp": 8}, "weight_exp is 8, but must be in 0..7"),
    (LateralInhibition, {"shape": (3,), "inhibition": -1}, "inhibition is -1, but must be at least 0"),
    (encoder, {"rates": np.ones((2, 3))}, "rates are float64 (2, 3), but must be uint16 (n, inputs)"),
    (encoder, {"rates": np.ones((2, 0), np.uint16)}, "PoissonEncoder: rates are uint16 (2, 0), but must be"),
    (
        encoder,
        {"keys": np.ones(2, int)},
        "keys are int64 (2,), but must be uint64 (2,), one for each row of rates",
    ),
    (encoder, {"silent_steps": -1}, "4 steps and -1 silent ones"),
    (encoder, {"keys": np.ones(3, np.uint64)}, "keys are uint64 (3,), but must be uint64 (2,)"),
    (encoder, {"steps": 0}, "0 steps and 3 silent ones, but at least 1 and 0 are needed"),
    (regular, {"steps": 2.5}, "RegularEncoder: 2.5 steps and 3 silent ones, but at least 1 and 0 are needed"),
    (regular, {"keys": np.ones(3, np.uint64)}, "RegularEncoder: keys are uint64 (3,), but must be uint64 (2,)"),
    (encoder, {"emitted": np.zeros(3, np.int32)}, "emitted is int32 (3,), but must be int64 (3,)"),
    (counter, {"presentations": 0}, "presentations is 0"),
    (counter, {"interval": 0}, "interval is 0"),
    (counter, {"raster": np.zeros((2, 5, 3), np.uint8)}, "raster is uint8 (2, 5, 3), but must be uint8 (2, 4, 3)"),
    (fused, {"batch": 0}, "batch is 0, but must be a whole number, at least 1"),
    (fused, {"rates": np.ones((2, 4), np.uint16)}, "rates' shape is (2, 4), but must be (n, 3)"),
    (fused, {"keys": np.ones(2)}, "keys are float64 (2,), but must be uint64 (2,)"),
    (fused, {"counts": np.zeros((2, 2))}, "counts is float64 (2, 2), but must be int32 (2, 2)"),
]


@pytest.mark.parametrize(("make", "changes", "text"), REFUSED)
def test_what_cannot_be_is_refused_when_it_is_made(make: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(NetworkLimitError) as caught:
        make(**changes)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_networks_that_could_overflow_are_refused() -> None:
    weights = np.full((140_000, 1), 1, np.int16)
    with pytest.raises(NetworkLimitError, match=r"weights above 0 of one neuron sum to 140,000, but Loihi's 24-bit"):
        PlaceNetwork(network=place(weights))
    with pytest.raises(NetworkLimitError, match="a bias of 700 makes its neuron spike without input"):
        PlaceNetwork(network=replace(place(weights[:3]), bias=np.array([700], np.int32)))


FLOATS = [
    (lambda: lif(vth=10.5), PyExcitatoryLIFFixed, PyExcitatoryLIFFloat, "vth is "),
    (lambda: lif(vth=2e5), PyExcitatoryLIFFixed, PyExcitatoryLIFFloat, "threshold is 200000"),
    (lambda: lif(floor=-60.5), PyExcitatoryLIFFixed, PyExcitatoryLIFFloat, "floor is "),
    (lambda: dense(weights=np.array([[0.5]])), PyDenseSynapsesFixed, PyDenseSynapsesFloat, "weight is 0.5"),
    (lambda: OneToOne(shape=(2,), weight=1.5), PyOneToOneFixed, PyOneToOneFloat, "weight is 1.5"),
]


@pytest.mark.parametrize(("make", "fixed", "floating", "text"), FLOATS)
def test_floats_are_for_the_float_model_only(make: Any, fixed: Any, floating: Any, text: str) -> None:
    make()._model_class = floating  # what Lava's compiler does when it has picked a model
    with pytest.raises(NetworkLimitError, match=text):
        make()._model_class = fixed
