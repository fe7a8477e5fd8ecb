"""The spiking front end, from pixels to the spikes of its cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.io.source import RingBuffer
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import BIAS_EXPONENT, NeuronGroup, event_synapses, populations, synapses
from lava_vpr.loihi import INPUT_SHIFT
from lava_vpr.processes.base.magma import (
    AbstractSubProcessModel,
    CheckedProcess,
    LoihiProtocol,
    OutPort,
    Var,
    implements,
)
from lava_vpr.processes.base.neurons import BiasTable
from lava_vpr.processes.lif.process import ExcitatoryLIF
from lava_vpr.processes.sparse_synapses.process import SparseSynapses


class FrontEndNetwork(CheckedProcess):
    """`FrontEnd` composed of an ExcitatoryLIF for each population, with SparseSynapses between them.

    Presents one image after another, each for ``spec.steps`` steps. A run that prefers SubProcessModels uses Lava's
    LIFReset and Sparse instead, and nothing else: what a board can run. It takes one image; `write` sets the others
    between runs. Where events drive the pixels, Lava's RingBuffer sends them.

    Ports: spikes of each population, by its name: ``clock``, ``pixels``, ``filters``, ``pairs``, ``onsets``, ``cells``,
    ``pools``; of a `WholeNetwork` also ``exc`` and ``inh``. Var ``shown``: the grey levels of the image that is
    presented, (pixels,); or the events of all images, a spike each, (axons, n steps). Vars of a `WholeNetwork`,
    (neurons,): ``bias_mant``, ``bias_exp``, the biases of ``exc``.
    """

    def __init__(
        self, *, spec: FrontEnd, grey: NDArray[np.uint8], bias: NDArray[np.int32] | None = None, **kwargs: Any
    ) -> None:
        """Make the network that is shown images.

        Args:
            spec: The front end; a `WholeNetwork`: with the neurons of places that hear its cells.
            grey: What it is given of each image (`FrontEnd.seen`), uint8 (n, *spec.shape), n at least 1.
            bias: Biases of ``exc`` in each presentation, int32 (n, neurons); None: its own.
        Raises:
            NetworkLimitError: images or biases of another type or shape.
        """
        shape = spec.shape
        fits = grey.dtype == np.uint8 and grey.ndim == 3 and grey.shape[1:] == shape and len(grey) > 0
        need(fits, "FrontEndNetwork: images", f"{grey.dtype} {grey.shape}", f"uint8 (n, {shape[0]}, {shape[1]})")
        neurons = spec.populations.get("exc", 0)
        if bias is not None:
            suits = neurons > 0 and bias.dtype == np.int32 and bias.shape == (len(grey), neurons)
            need(suits, "FrontEndNetwork: biases", f"{bias.dtype} {bias.shape}", f"int32 ({len(grey)}, {neurons})")
        super().__init__(spec=spec, grey=grey, bias=bias, **kwargs)
        self.spec, self.grey, self.bias = spec, grey, bias
        sizes = {name: (size,) for name, size in spec.populations.items()}
        self.clock, self.pixels = OutPort(sizes["clock"]), OutPort(sizes["pixels"])
        self.filters, self.pairs = OutPort(sizes["filters"]), OutPort(sizes["pairs"])
        self.onsets, self.cells, self.pools = (OutPort(sizes[name]) for name in ("onsets", "cells", "pools"))
        if "exc" in sizes:
            self.exc, self.inh = OutPort(sizes["exc"]), OutPort(sizes["inh"])
            self.bias_mant, self.bias_exp = Var(sizes["exc"]), Var(sizes["exc"])
        self.shown = Var(shape=_events(spec, grey).shape if spec.window else (spec.populations["pixels"],))

    def write(self, grey: NDArray[np.uint8], bias: NDArray[np.int32] | None = None, *, floating: bool = False) -> None:
        """Set what is shown while the run is paused, from the next step on.

        Args:
            grey: uint8 (*spec.shape,).
            bias: Biases of ``exc``, int32 (neurons,); None: they stay.
            floating: The run is of Lava's own floating-point models, whose biases are in the threshold's unit.
        """
        made = _events(self.spec, grey[None]) if self.spec.window else grey.reshape(-1).astype(np.int32)
        self.shown.set(made.astype(float) if floating else made)
        if bias is None:
            return
        mantissas, exponent = bias_registers(bias)
        if floating:
            self.bias_mant.set(mantissas * 2.0 ** (int(exponent) - INPUT_SHIFT))
        else:
            self.bias_mant.set(mantissas)
            self.bias_exp.set(np.full_like(mantissas, exponent))


def _events(spec: FrontEnd, counts: NDArray[np.uint8]) -> NDArray[np.int32]:
    """The events of every step of all presentations, int32 (axons, n steps)."""
    return spec.events(counts).reshape(len(counts) * spec.steps, -1).T.astype(np.int32)


@implements(proc=FrontEndNetwork, protocol=LoihiProtocol)
class SubFrontEndNetwork(AbstractSubProcessModel):
    """The populations and synapses of the spec. Every connection takes one step."""

    def __init__(self, proc: FrontEndNetwork) -> None:
        spec, n = proc.spec, len(proc.grey)
        levels = proc.grey.reshape(n, -1).astype(np.int32)
        tables = {} if spec.window else {"pixels": BiasTable(levels, np.full(n, BIAS_EXPONENT, np.int32))}
        if proc.bias is not None:
            tables["exc"] = BiasTable(*bias_registers(proc.bias))

        def made(name: str, one: NeuronGroup) -> ExcitatoryLIF:
            return ExcitatoryLIF(
                shape=(one.size,),
                du=one.du,
                dv=one.dv,
                vth=one.threshold,
                bias_mant=0 if one.bias is None else one.bias,
                bias_exp=one.bias_exp,
                reset_interval=spec.steps,
                bias_table=tables.get(name),
            )

        neurons = {name: made(name, one) for name, one in populations(spec).items()}
        parts: dict[str, ExcitatoryLIF | SparseSynapses | RingBuffer] = {**neurons}
        for number, one in enumerate(synapses(spec)):
            between = SparseSynapses(weights=one.weights, weight_exp=one.exponent)
            neurons[one.source].s_out.connect(between.s_in)
            between.a_out.connect(neurons[one.target].a_in)
            parts[f"synapses_{number}"] = between
        for name, population in neurons.items():
            population.s_out.connect(getattr(proc, name))
        if spec.window:
            source, axons = RingBuffer(data=_events(spec, proc.grey)), SparseSynapses(weights=event_synapses(spec))
            source.s_out.connect(axons.s_in)
            axons.a_out.connect(neurons["pixels"].a_in)
            parts |= {"source": source, "axons": axons}
            proc.shown.alias(source.data)
        else:
            proc.shown.alias(neurons["pixels"].bias_mant)
        if "exc" in neurons:
            proc.bias_mant.alias(neurons["exc"].bias_mant)
            proc.bias_exp.alias(neurons["exc"].bias_exp)
        self.__dict__.update(parts)  # where Lava looks for them
