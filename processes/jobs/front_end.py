"""The spiking front end in Lava as functions of arrays and options, to be called in a process of their own.

Each takes ``arrays``: ``grey`` uint8 (n, height, width); and ``options``: ``spec``, the settings of `FrontEnd` by name,
and ``tag``. Where neurons of places hear the cells, ``arrays`` has their ``weights`` and ``bias``, and may have
``biases`` of each presentation, int32 (n, neurons); ``options`` has ``network``, the scalars of `FixedNetwork`. Each
returns every spike of each population by its name, uint8 (n, steps,
neurons).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.whole import WholeNetwork
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.isolated.worker import report
from lava_vpr.processes.base.magma import FIXED_TAG, RunSteps
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.front_end.process import FrontEndNetwork
from lava_vpr.processes.jobs.inference import Arrays, Way, begin
from lava_vpr.processes.spike_counter.process import SpikeCounter


def _spec(arrays: Arrays, options: dict[str, Any]) -> FrontEnd:
    """The front end, with the network that hears its cells if one does."""
    numbers: dict[str, Any] = {name: tuple(x) if isinstance(x, list) else x for name, x in options["spec"].items()}
    if "network" not in options:
        return FrontEnd(**numbers)
    weights, bias = (np.ascontiguousarray(arrays[name]) for name in ("weights", "bias"))
    return WholeNetwork(**numbers, network=FixedNetwork.of_scalars(weights, bias, options["network"]))


def _shown(arrays: Arrays, options: dict[str, Any], library: bool) -> Arrays:
    """The front end and a counter of each population; with Lava's library an image is written before each run."""
    spec = _spec(arrays, options)
    grey, way = np.ascontiguousarray(arrays["grey"], np.uint8), Way(str(options.get("tag", FIXED_TAG)), library)
    n, steps = len(grey), spec.steps
    films = {name: shared_array((n, steps, size), np.uint8) for name, size in spec.populations.items()}
    if not n:
        return films
    shown = PixelBlock(grey, arrays.get("biases"))
    first = shown.part(slice(1)) if library else shown
    network = FrontEndNetwork(spec=spec, grey=first.grey, bias=first.bias)
    for name, film in films.items():
        counter = SpikeCounter(shape=film.shape[2:], presentations=n, interval=steps, raster=film)
        getattr(network, name).connect(counter.s_in)
    config = begin(network, way)
    for number in range(n):
        if library and number:
            network.write(grey[number], None if shown.bias is None else shown.bias[number], floating=way.floating)
        network.run(condition=RunSteps(num_steps=steps), run_cfg=config)
        report(1)
    network.stop()
    return films


def composed(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The front end composed of this project's Processes."""
    return _shown(arrays, options, library=False)


def library(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The same with Lava's library in their place."""
    return _shown(arrays, options, library=True)
