"""Activity to spike probabilities, and the plain definition of the spikes drawn from them.

Rates are the probability of a spike in one step: uint16 in units of 2^-16 for steps of 1 ms, uint32 in units of 2^-32
for the ``paper`` preset's 0.1 ms. An input spikes when its draw of the same width is below its rate.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.engine.inference import counting
from lava_vpr.engine.inference.biases import bias_input_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import Trains
from lava_vpr.engine.random import draws
from lava_vpr.inputs.encoder import EncoderConfig
from lava_vpr.inputs.front_end import BURST
from lava_vpr.inputs.kernels import shared_out
from lava_vpr.settings.conductance import ConductanceNetwork


def rates16(activity: NDArray[np.float32], spikes_per_step: float, count: int = 0) -> NDArray[np.uint16]:
    """Spike probabilities that bring every image the same expected number of input spikes per step.

    Args:
        activity: Responses, float32 (n, inputs); an image without any response stays silent.
        spikes_per_step: Expected spikes of all inputs together in one step.
        count: Only each image's ``count`` largest responses, and those equal to the least of them, spike; 0: all.
    Returns:
        uint16 (n, inputs) in units of 2^-16; a probability is at most 65535 / 65536.
    """
    rates: NDArray[np.uint16] = shared_out(np.ascontiguousarray(activity, np.float32), count, spikes_per_step)
    return rates


def rates32(activity: NDArray[np.float32], max_rate_hz: float, dt_ms: float) -> NDArray[np.uint32]:
    """The paper's rates: a pixel of 255 fires at ``max_rate_hz``; uint32 (n, inputs), units of 2^-32 per step."""
    probability = activity.astype(np.float64) * (max_rate_hz * dt_ms / 1000.0 / 255.0)
    return np.minimum(np.round(probability * 2.0**32), 2.0**32 - 1).astype(np.uint32)


def query_rates16(activity: NDArray[np.float32], encoder: EncoderConfig) -> NDArray[np.uint16]:
    """Rates of a query of the integer network (and of a reference for its response), uint16 (n, inputs); of cells that
    neurons hear directly, their bursts (`lava_vpr.inputs.front_end.FrontEnd.burst_codes`)."""
    if encoder.direct is not None:
        return encoder.direct.burst_codes(activity)
    return rates16(activity, encoder.query_spikes, encoder.query_inputs)


def training_rates(activity: NDArray[np.float32], config: Config) -> NDArray[np.uint16] | NDArray[np.uint32]:
    """Rates of a training presentation, as the network of ``config`` takes them."""
    if isinstance(config.network, ConductanceNetwork):
        return rates32(activity, config.encoder.max_rate_hz, config.network.dt_ms)
    return rates16(activity, config.encoder.learning_spikes)


def query_rates(activity: NDArray[np.float32], config: Config) -> NDArray[np.uint16] | NDArray[np.uint32]:
    """Rates of a query (and of the references when their responses are measured)."""
    if isinstance(config.network, ConductanceNetwork):
        return rates32(activity, config.encoder.max_rate_hz, config.network.dt_ms)
    return query_rates16(activity, config.encoder)


def draw_spikes(rates: NDArray[np.uint16] | NDArray[np.uint32], key: int, steps: int) -> NDArray[np.bool_]:
    """The input spikes of one presentation, bool (steps, inputs); plain numpy, the definition of every backend's input.

    Args:
        rates: uint16 or uint32 (inputs,), units of 2^-16 or 2^-32.
        key: From `lava_vpr.engine.random.presentation_key`.
        steps: Steps with input.
    """
    return draws(key, steps, len(rates), bits=rates.dtype.itemsize * 8) < rates[None, :]


def draw_trains(
    rates: NDArray[np.uint16], keys: NDArray[np.uint64], steps: int, total: int, *, regular: bool = False
) -> NDArray[np.uint8]:
    """The input spikes of many presentations, uint8 (n, total, inputs); silent after ``steps`` steps.

    Args:
        rates: uint16 (n, inputs).
        keys: uint64 (n,).
        steps: Steps with input.
        total: Steps of a presentation.
        regular: `lava_vpr.engine.inference.biases.bias_input_spikes` instead of `draw_spikes`.
    """
    spikes_of = bias_input_spikes if regular else draw_spikes
    trains = np.zeros((len(rates), total, rates.shape[1]), np.uint8)
    for train, image_rates, key in zip(trains, rates, keys, strict=True):
        train[:steps] = spikes_of(image_rates, int(key), steps)
    return trains


def burst_trains(bursts: NDArray[np.uint16], total: int) -> NDArray[np.uint8]:
    """The spikes that ``bursts`` (n, inputs) are, uint8 (n, total, inputs) (`FrontEnd.burst_codes`)."""
    step, first = np.arange(total)[:, None], (bursts // BURST)[:, None]
    return ((step >= first) & (step < first + (bursts % BURST)[:, None])).astype(np.uint8)


def spike_trains(
    network: FixedNetwork,
    rates: NDArray[np.uint16],
    keys: NDArray[np.uint64],
    *,
    bias: NDArray[np.int32] | None = None,
    threads: int = 1,
) -> Trains:
    """Every spike of many presentations to ``network``, by the host engine; arguments as in `counting.count_spikes`."""
    _, _, exc = counting.count_spikes(network, rates, keys, bias=bias, threads=threads, raster=True)
    if network.direct:
        inputs = burst_trains(rates, network.interval)
    else:
        inputs = draw_trains(rates, keys, network.steps, network.interval, regular=network.regular)
    return Trains(exc, inputs, counting.inhibitory_spikes(network, exc))
