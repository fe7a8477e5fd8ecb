"""Register-level simulation of Loihi 1: runs the content of a bundle without knowledge of the network behind it.

A step of a core: every accumulator becomes the current of its compartment, u' = D(u, 4095 - decayU) + a, which wraps at
24 bits; v' = clip(D(v, 4096 - decayV) + u' + bias), with D(x, k) = sign(x) (|x| k >> 12); v' > vth << 6 spikes, and v'
is 0 then and in the refractory steps. Each spike then goes along the output axons of its compartment, and each input
axon that it meets adds its row to the accumulators, which count in the next step. Source: nengo-loihi 1.1.0,
``emulator/interface.py``. Faults that the chip would not report are errors here: an accumulator beyond its 21 bits, and
a state that nothing clears between two presentations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.registers.core_images import COUNTER_UNIT, CoreImage, HostTables
from lava_vpr.deploy.registers.simulator_kernels import State, Wiring, present
from lava_vpr.deploy.registers.synapse_memory import stored_rows, unpack
from lava_vpr.deploy.registers.synapses import SynapseFormat, SynapseRows, joined
from lava_vpr.engine.inference.biases import bias_input_spikes, biases, start_membranes
from lava_vpr.engine.rates import draw_spikes
from lava_vpr.errors import ModelFileError, NetworkLimitError
from lava_vpr.loihi import (
    CEILING_EXPONENT_OFFSET,
    CEILING_EXPONENT_STEP,
    DECAY_BITS,
    DECAY_UNITY,
    INPUT_SHIFT,
    LOIHI_1_INPUT_LIMIT,
)

Cores = tuple[tuple[int, int], ...]


class Presented(NamedTuple):
    """Results of some presentations on the chips.

    Attributes:
        exc, inh, inputs: Every spike, uint8 (n, steps, width).
        counts: Spikes of each exc neuron, as the membrane of its counter holds them, int32 (n, neurons).
    """

    exc: NDArray[np.uint8]
    inh: NDArray[np.uint8]
    inputs: NDArray[np.uint8]
    counts: NDArray[np.int32]


class _Core(NamedTuple):
    """Registers of a core, and its input axons' rows.

    Attributes:
        table: Remaining shares of u and v after a step, refractory steps, threshold and bias, int64 (5, compartments).
        limits: Bounds of the membranes.
        row_of: The row of each input axon.
        rows: The rows.
        value: What each synapse adds to its compartment.
    """

    table: NDArray[np.int64]
    limits: tuple[int, int]
    row_of: NDArray[np.int64]
    rows: SynapseRows
    value: NDArray[np.int32]


def _fault(where: str, what: str) -> ModelFileError:
    """The error for a bundle with invalid content."""
    return ModelFileError(f"{where}: {what}; deploy the model again")


def _read(image: CoreImage) -> _Core:
    """The registers and rows of a core.

    Raises:
        ModelFileError: its memory is not what the synapse map says it is.
    """
    where, registers = image.name, image.registers
    profiles = [[p["decayU"], p["decayV"], p["refractDelay"]] for p in registers["cxProfileCfg"]]
    vth = np.array([v["vth"] for v in registers["vthProfileCfg"]], np.int64)
    shared = registers["dendriteSharedCfg"]
    floor, ceiling = int(shared["negVmLimit"]), int(shared["posVmLimit"])
    forms = [None if form is None else SynapseFormat.of(form, where) for form in registers["synapseFmt"]]
    profile, register, mantissa, exponent = image.compartments.T.astype(np.int64)
    decay_u, decay_v, refract = np.array(profiles, np.int64).reshape(-1, 3)[profile].T
    entries, row_of = stored_rows(image.synapses, image.axons_in, where)
    rows = unpack(image.synapses, entries, forms, len(image.compartments), where)
    return _Core(
        np.stack(
            [
                DECAY_UNITY - 1 - decay_u,
                DECAY_UNITY - decay_v,
                refract,
                vth[register] << INPUT_SHIFT,
                mantissa << exponent,
            ]
        ),
        (1 - (1 << floor), (1 << CEILING_EXPONENT_OFFSET + CEILING_EXPONENT_STEP * ceiling) - 1),
        row_of,
        rows,
        rows.currents(forms),
    )


def _starts(sizes: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    """0 and the sums of ``sizes`` so far, int64 (sizes + 1,)."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(np.asarray(sizes, np.int64))])


def _located(
    pairs: NDArray[np.int32], numbers: NDArray[np.int32], starts: NDArray[np.int64], cores: Cores
) -> NDArray[np.int64]:
    """Positions among all compartments of ``numbers`` (n,) on the cores of ``pairs`` (n, 2: chip, core)."""
    index = {pair: k for k, pair in enumerate(cores)}
    named, inverse = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    return starts[np.array([index[a, b] for a, b in named.tolist()], np.int64)[inverse.reshape(-1)]] + numbers


class Wired(NamedTuple):
    """Cores and their axons as the kernel takes them.

    Attributes:
        cores: Chip and core of each.
        wiring: Their compartments, axons and rows.
        threshold, bias: Of each compartment, in units of v, int64 (compartments,).
    """

    cores: Cores
    wiring: Wiring
    threshold: NDArray[np.int64]
    bias: NDArray[np.int64]

    @staticmethod
    def of(images: Sequence[CoreImage]) -> Wired:
        """The cores and axons of ``images``.

        Raises:
            ModelFileError: the memory of a core is not what its synapse map says it is.
        """
        cores = tuple((image.chip, image.core) for image in images)
        read = [_read(image) for image in images]
        table = np.concatenate([core.table for core in read], axis=1)
        return Wired(cores, _wire(images, read, table, cores), table[3], table[4])

    def rested(self) -> State:
        """All compartments at rest, with their own biases."""
        u, v, sums, held = np.zeros((4, len(self.bias)), np.int64)
        return State(u, v, sums, held, self.bias.copy())

    def at(self, table: NDArray[np.int32]) -> NDArray[np.int64]:
        """Positions among all compartments of those given by chip, core and number (n, 3), int64 (n,)."""
        return _located(table[:, :2], table[:, 2], self.wiring.first, self.cores)

    def name(self, i: int) -> str:
        """The name of a compartment in messages."""
        k = int(np.searchsorted(self.wiring.first, i, side="right")) - 1
        return f"chip {self.cores[k][0]} core {self.cores[k][1]} compartment {i - self.wiring.first[k]}"

    def check(self, state: State, presentation: int, flying: int, overflow: int) -> None:
        """Refuse a presentation with an overflow, or after which spikes are in flight.

        ``flying``: messages in flight after the last step (with an overflow: the step), see `present`.
        """
        if overflow >= 0:
            need, where = abs(int(state.sums[overflow])) >> INPUT_SHIFT, self.name(overflow)
            raise NetworkLimitError(
                f"{where}: receives {need:,} in step {flying} of presentation {presentation}, but its accumulator "
                f"holds less than {LOIHI_1_INPUT_LIMIT:,}; lower network.inhibition or use fewer weight bits"
            )
        if flying:
            raise _fault(f"presentation {presentation}", f"{flying} spikes are still on their way after its last step")


def _wire(images: Sequence[CoreImage], read: Sequence[_Core], table: NDArray[np.int64], cores: Cores) -> Wiring:
    """The cores and their axons as the kernel takes them; see `Chips.of`."""
    first, axons = _starts([len(i.compartments) for i in images]), _starts([len(i.axons_in) for i in images])
    sizes = [len(core.rows.formats) for core in read]
    rows = joined([core.rows for core in read])
    owner = np.repeat(np.arange(len(cores)), [len(i.axons_out) for i in images])
    out = np.concatenate([np.zeros((0, 4), np.int32), *(image.axons_out for image in images)]).astype(np.int64)
    axon = _located(out[:, 1:3], out[:, 3], axons, cores)
    order = np.argsort(first[owner] + out[:, 0], kind="stable")
    row_starts = _starts(sizes)[:-1]
    return Wiring(
        first=first,
        keep_u=table[0],
        keep_v=table[1],
        refract=table[2],
        floor=np.array([core.limits[0] for core in read], np.int64),
        ceiling=np.array([core.limits[1] for core in read], np.int64),
        out_start=_starts(np.bincount(first[owner] + out[:, 0], minlength=int(first[-1]))),
        out_axon=axon[order],
        row_of=np.concatenate([core.row_of + start for core, start in zip(read, row_starts, strict=True)]),
        row_start=rows.starts,
        row_target=(rows.compartments + np.repeat(first[:-1], [len(c.value) for c in read])).astype(np.int32),
        row_value=np.concatenate([core.value for core in read]),
    )


@dataclass(frozen=True)
class Chips:
    """Loihi 1 chips that hold a network; see `Chips.of`."""

    wired: Wired = field(repr=False)
    injection: tuple[NDArray[np.int64], ...] = field(repr=False)
    exc: NDArray[np.int64] = field(repr=False)
    counters: NDArray[np.int64] = field(repr=False)
    inh: NDArray[np.int64] = field(repr=False)
    inputs: NDArray[np.int64] = field(repr=False)
    steps: int
    silent_steps: int
    regular: bool
    bias_input: bool

    @staticmethod
    def of(
        images: Sequence[CoreImage],
        tables: HostTables,
        *,
        steps: int,
        silent_steps: int,
        regular: bool,
        bias_input: bool,
    ) -> Chips:
        """The chips whose cores hold ``images``.

        Args:
            images: Images of all cores, as `core_images` writes them and an opened bundle has them.
            tables: The addresses of the network on them for the host.
            steps: Steps with input of a presentation.
            silent_steps: Steps without input after those.
            regular: Whether injected spikes are regular trains; else they are Poisson draws.
            bias_input: Whether input compartments integrate a bias; else spikes are injected, possibly into relays.
        Raises:
            ModelFileError: the memory of a core is not what its synapse map says it is.
        """
        wired = Wired.of(images)
        places = {name: getattr(tables, name) for name in ("exc", "counters", "inh", "inputs")}
        axons = _starts([len(image.axons_in) for image in images])
        way = tables.injection[np.argsort(tables.injection[:, 0], kind="stable")]
        axon = _located(way[:, 1:3], way[:, 3], axons, wired.cores)
        return Chips(
            wired,
            (way[:, 0].astype(np.int64), axon),
            **{name: wired.at(table) for name, table in places.items()},
            steps=steps,
            silent_steps=silent_steps,
            regular=regular,
            bias_input=bias_input,
        )

    def present(
        self,
        rates: NDArray[np.uint16],
        keys: NDArray[np.uint64],
        bias: NDArray[np.int32] | None = None,
    ) -> Presented:
        """Present images, as the host program does.

        Args:
            rates: Spike probabilities in units of 2^-16, uint16 (n, inputs).
            keys: One per presentation (`lava_vpr.engine.random.presentation_keys`), uint64 (n,).
            bias: Biases written to exc before each presentation, in units of v, int32 (n, neurons); None: none.
        Raises:
            NetworkLimitError: an accumulator overflows.
            ModelFileError: the cores do not come to rest after a presentation.
        """
        n, total, inputs = len(rates), self.steps + self.silent_steps, rates.shape[1]
        counts = np.zeros((n, self.exc.size), np.int32)
        draw, written = bias_input_spikes if self.regular else draw_spikes, self._written()
        exc, inh, sent = (np.zeros((n, total, width), np.uint8) for width in (self.exc.size, self.inh.size, inputs))
        wiring, state = self.wired.wiring, self.wired.rested()
        for q in range(n):
            film = np.zeros((total, wiring.keep_u.size), np.uint8)
            drawn = np.zeros((total, inputs), np.bool_)
            self._write(state, rates[q], int(keys[q]), None if bias is None else bias[q])
            if not self.bias_input:
                drawn[: self.steps] = draw(rates[q], int(keys[q]), self.steps)
            shown = self.wired.threshold, written, self.steps, *self._sent(drawn)
            flying, overflow = present(wiring, state, *shown, film)
            self.wired.check(state, q, flying, overflow)
            self._check(state, q)
            counts[q] = state.v[self.counters] // COUNTER_UNIT
            exc[q], inh[q] = film[:, self.exc], film[:, self.inh]
            sent[q] = film[:, self.inputs] if self.bias_input else drawn
        return Presented(exc, inh, sent, counts)

    def _written(self) -> NDArray[np.int64]:
        """The input compartments that the host writes to: those that integrate a bias, not relays."""
        return self.inputs if self.bias_input else self.inputs[:0]

    def _write(self, state: State, rates: NDArray[np.uint16], key: int, bias: NDArray[np.int32] | None) -> None:
        """Write v = 0 of exc and counters and, if there is one, the ``bias`` of exc; bias and membrane of the inputs.

        Besides these, only the inputs' biases are written again: to 0 for the silent steps.
        """
        state.v[self.exc] = state.v[self.counters] = 0
        if bias is not None:
            state.bias[self.exc] = bias
        if self.bias_input:
            state.bias[self.inputs] = np.left_shift(*biases(rates))
            state.v[self.inputs] = start_membranes(key, len(rates))

    def _sent(self, drawn: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The input axons into which ``drawn`` (steps, inputs) is injected: the start of each step in the list, and the
        list."""
        source, axon = self.injection
        steps, inputs = np.nonzero(drawn)
        low, high = np.searchsorted(source, inputs), np.searchsorted(source, inputs, side="right")
        sizes = high - low
        ways = np.arange(sizes.sum()) + np.repeat(low - _starts(sizes)[:-1], sizes)
        by_step = np.bincount(steps, weights=sizes, minlength=len(drawn)).astype(np.int64)
        return _starts(by_step), axon[ways]

    def _check(self, state: State, presentation: int) -> None:
        """Refuse a presentation after which the cores are not at rest."""
        kept = state.v != 0
        kept[self.exc] = kept[self.counters] = kept[self._written()] = False
        active = kept | (abs(state.u) * self.wired.wiring.keep_u >> DECAY_BITS != 0) | (state.held != 0)
        if active.any():
            what = f"is not at rest after presentation {presentation}, and nothing clears it"
            raise _fault(self.wired.name(int(np.argmax(active))), what)
