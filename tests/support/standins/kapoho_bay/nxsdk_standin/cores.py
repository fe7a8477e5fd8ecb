"""Chips and cores as NxSDK shows them, and whether what was configured is a network that the chip can run."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.hardware.nxsdk_registers import WITH_INDICES
from lava_vpr.deploy.hardware.table import BELIEFS
from nxsdk_standin.faults import StandinError
from nxsdk_standin.registers import Array, Register, fields_of, held

WEIGHT_BITS: tuple[int, ...] = (0, *BELIEFS["widths of a weight, by wgtBits from 1 on"].value)  # type: ignore[misc]
INDEX_BITS: tuple[int, ...] = (0, *BELIEFS["widths of an index, by idxBits from 1 on"].value)  # type: ignore[misc]
AXONS, WORDS = held("input axons of a core; output axons, too"), held("words of synapse memory of a core")
COMPARTMENTS, GROUP = held("compartments of a core"), held("compartments that are updated together")
PROFILES, THRESHOLDS = held("distinct pairs of decays of a core"), held("distinct thresholds of a core")
FORMATS, BLOCK = held("synapse formats of a core, number 0 unused"), held("synapses of a block of synapse memory")
WORD, HEADER = held("bits of a word of synapse memory"), held("bits before the synapses of a block")
SPARSE = held(f"synapseFmt.compression ({WITH_INDICES})")


class Axon(NamedTuple):
    """An output axon."""

    source: int
    chip: int
    core: int
    axon: int


class Core:
    """One core."""

    def __init__(self, chip: Chip, number: int, synapses: int) -> None:
        self.parent, self.number, self.id = chip, number, 4 + 3 * number % 128  # no program may count on the order
        where = f"chip {chip.number} core {number}: "
        self.where = where
        self.cxProfileCfg = Array(where + "cxProfileCfg", PROFILES, fields_of("cxProfileCfg"))
        self.vthProfileCfg = Array(
            where + "vthProfileCfg", THRESHOLDS, {}, {"staticCfg": fields_of("vthProfileCfg.staticCfg")}
        )
        self.synapseFmt = Array(where + "synapseFmt", FORMATS, fields_of("synapseFmt"))
        self.dendriteSharedCfg = Register(where + "dendriteSharedCfg", fields_of("dendriteSharedCfg"))
        self.dendriteAccumCfg = Register(where + "dendriteAccumCfg", fields_of("dendriteAccumCfg"))
        self.cxCfg = Array(where + "cxCfg", COMPARTMENTS, fields_of("cxCfg"))
        self.cxMetaState = Array(where + "cxMetaState", COMPARTMENTS // GROUP, fields_of("cxMetaState"))
        self.synapses = Array(where + "synapses", synapses, fields_of("synapses"))
        self.synapseMap = Array(
            where + "synapseMap",
            AXONS,
            fields_of("synapseMap"),
            {"discreteMapEntry": fields_of("synapseMap.discreteMapEntry")},
        )
        self.numUpdates = Register(where + "numUpdates", fields_of("numUpdates"))
        self.dendriteTimeState = Array(where + "dendriteTimeState", 1, fields_of("dendriteTimeState"))
        self.timeState = Array(where + "timeState", 1, fields_of("timeState"))
        self.axons: list[Axon] = []

    def createDiscreteAxon(self, srcCxId: int, dstChipId: int, dstCoreId: int, dstSynMapId: int) -> None:
        """An output axon."""
        axon = Axon(srcCxId, dstChipId, dstCoreId, dstSynMapId)
        if any(type(value) is not int for value in axon):
            raise StandinError(f"{self.where}createDiscreteAxon takes integers, not {axon}")
        if axon in self.axons:
            raise StandinError(f"{self.where}{axon} is created twice")
        self.axons.append(axon)

    @property
    def used(self) -> bool:
        """Whether anything was configured."""
        return bool(self.cxCfg.used or self.synapses.used or self.synapseMap.used or self.axons)

    def formats(self) -> dict[int, Register]:
        """Synapse formats by number, whole and of the kinds that are public."""
        for number, form in self.synapseFmt.used.items():
            for field in fields_of("synapseFmt"):
                getattr(form, field)
            if number == 0 or (form.compression == SPARSE and form.idxBits == 0):
                raise StandinError(f"{form.where}: not a usable format")
        return self.synapseFmt.used

    def row(self, entry: Register, compartments: int) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
        """Compartments, weights in units of u and words of the row of an input axon."""
        formats = self.formats()
        _ = entry.discreteMapEntry.cxBase  # type: ignore[attr-defined]
        if entry.synapsePtr + entry.synapseLen > self.synapses.size:
            raise StandinError(f"{entry.where}: beyond the synapses of the core")
        own = [self.synapses[entry.synapsePtr + i] for i in range(entry.synapseLen)]
        numbers = {synapse.synFmtId for synapse in own}
        if len(numbers) != 1 or not numbers <= set(formats):
            raise StandinError(f"{entry.where}: its row has formats {numbers}")
        form = formats[numbers.pop()]
        bits, index_bits = WEIGHT_BITS[form.wgtBits], INDEX_BITS[form.idxBits]
        places = np.array([synapse.CIdx for synapse in own])
        weights = np.array([synapse.Wgt for synapse in own])
        sizes = np.abs(weights)
        if (sizes % (1 << 9 - bits)).any() or (sizes > 255).any():
            raise StandinError(f"{entry.where}: a weight does not fit {bits} bits")
        if (places >= compartments).any() or any(synapse.LrnEn for synapse in own):
            raise StandinError(f"{entry.where}: a synapse leads nowhere, or learns")
        if index_bits and (places >> index_bits).any():
            raise StandinError(f"{entry.where}: a compartment does not fit {index_bits} bits")
        if not index_bits and (places != np.arange(len(places))).any():
            raise StandinError(f"{entry.where}: a dense row is not in order")
        if index_bits and len(set(places.tolist())) < len(places):
            raise StandinError(f"{entry.where}: two synapses lead to one compartment")
        shift = 6 + form.wgtExp
        values = np.sign(weights) * (sizes << shift if shift >= 0 else sizes >> -shift)
        blocks = [min(BLOCK, len(own) - i) for i in range(0, len(own), BLOCK)]
        return places, values, sum(math.ceil((n * (bits + index_bits) + HEADER) / WORD) for n in blocks)

    @cached_property
    def network(self) -> dict[str, Any]:
        """What the simulation needs.

        Raises:
            StandinError: something is missing, out of order, left over or too much.
        """
        n = self.cxCfg.contiguous()
        self.synapseMap.contiguous()
        if n == 0 or self.numUpdates.numUpdates != -(-n // GROUP) or self.numUpdates.numStdp != 0:
            raise StandinError(f"{self.where}{n} compartments need {-(-n // GROUP)} updates")
        if len(self.synapses.used) != self.synapses.size:
            raise StandinError(f"{self.where}{len(self.synapses.used)} of {self.synapses.size} synapses are configured")
        epochs = [x.tepoch for x in (*self.timeState, *self.dendriteTimeState)]
        if self.dendriteAccumCfg.delayBits != 3 or epochs != [2, 2]:
            raise StandinError(f"{self.where}delayBits or tepoch are not those of other programs")
        for i in range(n):
            if getattr(self.cxMetaState[i // 4], f"phase{i % 4}") != 2:
                raise StandinError(f"{self.where}compartment {i} is not in the phase that integrates")
        cells = list(self.cxCfg)
        table = np.array([(c.vthProfile, c.cxProfile, c.bias, c.biasExp) for c in cells])
        if not set(table[:, 0]) <= set(self.vthProfileCfg.used) or not set(table[:, 1]) <= set(self.cxProfileCfg.used):
            raise StandinError(f"{self.where}a compartment names a profile that is not configured")
        profiles = {i: (p.decayU, p.decayV) for i, p in self.cxProfileCfg.used.items()}
        for profile in self.cxProfileCfg:
            if (profile.refractDelay, profile.enableNoise, profile.bapAction) != (1, 0, 1):
                raise StandinError(f"{profile.where}: refractoriness or noise is not simulated")
        rows, taken, spans = [], 0, {}
        for entry in self.synapseMap:
            places, values, words = self.row(entry, n)
            rows.append((places, values))
            spans[entry.synapsePtr] = (entry.synapseLen, words)
        for pointer, (length, _) in sorted(spans.items()):
            if pointer != taken:
                raise StandinError(f"{self.where}synapses {taken} to {pointer} belong to no axon, or to two rows")
            taken += length
        if taken != self.synapses.size or sum(words for _, words in spans.values()) > WORDS:
            raise StandinError(f"{self.where}synapses are left over, or need more than {WORDS} words")
        if len(self.axons) > AXONS or any(not 0 <= axon.source < n for axon in self.axons):
            raise StandinError(f"{self.where}output axons are too many, or of no compartment")
        return {
            "decays": np.array([profiles[i] for i in table[:, 1]]),
            "table": table,
            "levels": {i: p.staticCfg.vth for i, p in self.vthProfileCfg.used.items()},  # type: ignore[attr-defined]
            "rows": rows,
            "limits": (
                -(1 << self.dendriteSharedCfg.negVmLimit) + 1,
                (1 << 9 + 2 * self.dendriteSharedCfg.posVmLimit) - 1,
            ),
        }


class Chip:
    """One chip."""

    def __init__(self, number: int, synapses: list[int]) -> None:
        self.number, self.id = number, 5 + 2 * number  # no program may count on it being its number
        self.n2CoresAsList = [Core(self, i, n) for i, n in enumerate(synapses)]
