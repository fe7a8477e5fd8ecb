"""What Lava's own library has for this project's Processes: their SubProcessModels, which a chip can run.

A run that prefers SubProcessModels (``select_sub_proc_model=True``) puts LIF, LIFReset, Dense, Sparse and LearningDense
instead of this project's Processes: simulated under ``Loihi2SimCfg``, on the chip under ``Loihi2HwCfg``. What the
library lacks is refused. In a ``process.py`` these models come before those for the CPU: Lava 0.10 counts positions
among SubProcessModels as if they were positions among all (``magma/core/run_configs.py:285``).
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from lava.proc.dense.process import Dense
from lava.proc.lif.process import LIF, LIFReset
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from lava_vpr.engine.general.lif import need
from lava_vpr.loihi import DECAY_UNITY, INPUT_SHIFT
from lava_vpr.processes.base.magma import AbstractProcess, AbstractSubProcessModel, RegisterVar
from lava_vpr.processes.base.neurons import NO_FLOOR, LifProcess

MISSING = "left out with Lava's library; run it without select_sub_proc_model"
"""What to do about a parameter that only this project's own models have."""


CONSTANT = ("du", "dv", "vth", "held", "floor", "hold_steps", "theta_plus")
"""Vars of a `LifProcess` that cannot be set with Lava's library: it has them in another form, or not at all."""


def stand_for(proc: Any, part: AbstractProcess, *shared: str, constant: tuple[str, ...] = ()) -> None:
    """Let Vars of ``proc`` be those of the library's Process ``part``.

    Args:
        proc: The Process that ``part`` stands for.
        part: The library's.
        *shared: Names of Vars that both have.
        constant: Names of those that the library has in another form: they can be read, but not set.
    """
    for name in shared:
        getattr(proc, name).alias(getattr(part, name))
    for name in constant:
        var: RegisterVar = getattr(proc, name)
        var.constant = True


def library_neurons(proc: LifProcess, floating: bool) -> LIF:
    """The LIFReset, or the LIF of neurons that are never reset, with the numbers of ``proc``.

    The library's floating-point models take decays as fractions, ignore exponents of biases, and have the bias in the
    threshold's unit.

    Raises:
        NetworkLimitError: a floor, a hold, rising or unequal thresholds, or biases of many presentations.
    """
    first = {name: getattr(proc, name).init for name in ("du", "dv", "vth", "bias_mant", "bias_exp")}
    own = type(proc).__name__
    for name, none in (("floor", NO_FLOOR), ("hold_steps", 0), ("theta_plus", 0)):
        value = getattr(proc, name).init[0]
        need(value == none, f"{own}: {name}", value, MISSING)
    vth, du, dv = first["vth"], first["du"][0], first["dv"][0]
    need(bool((vth == vth[0]).all()), f"{own}: vth", vth, f"one for all: others are {MISSING}")
    table = proc.proc_params.get("bias_table")
    if table is not None:
        rows = len(table.exponents)
        need(rows == 1, f"{own}: biases of presentations", rows, "1 with Lava's library; write the others in pauses")
        first |= {"bias_mant": table.mantissas[0], "bias_exp": np.full_like(table.mantissas[0], table.exponents[0])}
    # The threshold is an int where it can be: other types cannot be read back.
    numbers: dict[str, Any] = {"vth": int(vth[0]) if vth[0] == int(vth[0]) else vth[0]}
    if floating:
        numbers |= {"du": (du + 1) / DECAY_UNITY, "dv": dv / DECAY_UNITY}
        numbers["bias_mant"] = first["bias_mant"] * 2.0 ** (first["bias_exp"] - INPUT_SHIFT)
    else:
        numbers |= {"du": int(du), "dv": int(dv)}
        numbers |= {name: first[name].astype(np.int32) for name in ("bias_mant", "bias_exp")}
    interval = proc.proc_params["reset_interval"]
    if not interval:
        return LIF(shape=vth.shape, **numbers)
    return LIFReset(shape=vth.shape, reset_interval=interval, reset_offset=1, **numbers)


class LibraryNeurons(AbstractSubProcessModel):
    """A population of Lava's library instead of a `LifProcess`."""

    floating: bool

    def __init__(self, proc: LifProcess) -> None:
        if not self.floating:
            proc.check_fixed()
        self.neurons = library_neurons(proc, self.floating)
        proc.a_in.connect(self.neurons.a_in)
        self.neurons.s_out.connect(proc.s_out)
        stand_for(proc, self.neurons, "u", "v", "bias_mant", "bias_exp", constant=CONSTANT)


class LibrarySynapses(AbstractSubProcessModel):
    """Synapses of Lava's library instead of this project's; those of a model are what `made` makes."""

    floating: bool
    shared: tuple[str, ...] = ("a_buff", "weights")
    constant: tuple[str, ...] = ()

    def __init__(self, proc: Any) -> None:
        if not self.floating:
            proc.check_fixed()
        self.synapses = self.made(proc)
        proc.s_in.connect(self.synapses.s_in)
        self.synapses.a_out.connect(proc.a_out)
        stand_for(proc, self.synapses, *self.shared, constant=self.constant)

    @abstractmethod
    def made(self, proc: Any) -> Dense | Sparse:
        """The library's Process."""


def library_synapses(
    weights: NDArray[Any] | csr_matrix,
    weight_exp: int,
    sign_mode: SignMode,
    *,
    floating: bool,
    sparse: bool,
    bits: int = 8,
    messages: int = 0,
) -> Dense | Sparse:
    """Synapses that do not learn.

    Args:
        weights: (post, pre).
        weight_exp: Their exponent, which the library's floating-point models ignore.
        sign_mode: Lava's.
        floating: For those models.
        sparse: As Sparse, which does not store weights of 0; else as Dense.
        bits: Bits that are stored of a weight.
        messages: Bits of the numbers that inputs send; 0: spikes.
    """
    values = weights * 2.0**weight_exp if floating else weights.astype(np.int32)
    kept: dict[str, Any] = {"num_weight_bits": bits, "weight_exp": weight_exp, "sign_mode": sign_mode}
    kept |= {"num_message_bits": messages}
    return Sparse(weights=csr_matrix(values), **kept) if sparse else Dense(weights=values, **kept)
