"""Registers of a Loihi 1 core by NxSDK's names, and the values of each that a public program writes.

The name of a row is the register's, a dot, and the field's; a row without a source has the value that no public program
writes, behind the same name in brackets.
"""

from __future__ import annotations

from lava_vpr import loihi
from lava_vpr.deploy.hardware.belief import DENSE, NARROW, Given, HardwareBelief, Span, Value
from lava_vpr.deploy.hardware.loihi_1 import DAVIES, NENGO

UNUSED_FIELDS = (
    "wgtLimitMant",
    "wgtLimitExp",
    "discMaxWgt",
    "learningCfg",
    "tagBits",
    "dlyBits",
    "reuseSynData",
    "cIdxOffset",
    "cIdxMult",
    "skipBits",
    "synType",
    "stdpProfile",
    "ignoreDly",
)
"""Fields of a synapse format that stay 0: no learning, no delays, no tags."""


WITH_INDICES = "rows with indices, of discrete axons"
"""What is asked for where rows are stored sparse, as all bundles have some."""

_BUILDER = f"{NENGO}hardware/builder.py"
_ALL = "every spike"
_DENSE = (
    f"{NENGO}block.py:521 counts no index bits with compression 3, but does so for sparse matrices, too (752), and "
    "never writes idxBits 0"
)
_INDEXED = (
    f"{NENGO}block.py:519 counts index bits with compression 0, but writes it for population axons alone (781); axons "
    "as here have compression 3 with index bits (752), which takes no more memory by its count (521)"
)
_NARROW = (
    f"{NENGO}block.py:417 has the width of every code and builder/validate.py:106 allows them, as does the chip's "
    f"paper ({DAVIES}: 1 to 9 bits); 8 bits alone are written (block.py:731)"
)
_DENSE_BREAKS = "NxSDK refuses the network, or weights go to other neurons; plans with such rows need more cores"


def _register(name: str, value: Value, line: str, breaks: str = _ALL, unit: str | None = None) -> HardwareBelief:
    """A register that a public program writes at ``line`` of nengo-loihi's builder, and more."""
    return HardwareBelief(name, "NxSDK, Loihi 1 core", "register", value, unit, breaks, f"{_BUILDER}:{line}")


def _unproven(name: str, value: Value, why: str, breaks: str, of: str = "") -> HardwareBelief:
    """A value that no public program writes, but bundles do: all of them, or those that have what ``of`` says."""
    rests = (f"Loihi 1: {of}" if of else "Loihi 1",)
    return HardwareBelief(name, "NxSDK, Loihi 1 core", "register", value, None, breaks, None, why, rests=rests)


NEURONS: tuple[HardwareBelief, ...] = (
    _register("cxProfileCfg.decayU", Span(0, loihi.NO_MEMORY_DECAY), "113, hardware/validate.py:43-44", unit="1/4096"),
    _register("cxProfileCfg.decayV", Span(0, loihi.NO_MEMORY_DECAY), "112, hardware/validate.py:45-46", unit="1/4096"),
    _register(
        "cxProfileCfg.refractDelay",
        Span(loihi.LEAST_REFRACTORY_STEPS, loihi.MOST_REFRACTORY_STEPS),
        "114, hardware/validate.py:47-48 (1 is no refractoriness)",
        unit="steps",
    ),
    _register("cxProfileCfg.enableNoise", (0, 1), "115, hardware/validate.py:49", "noise is added"),
    _register("cxProfileCfg.bapAction", 1, "116", "none known: it is about learning"),
    _register(
        "vthProfileCfg.staticCfg.vth",
        Span(1, loihi.THRESHOLD_LIMIT - 1),
        "121, hardware/validate.py:53-54",
        unit="64 units of v",
    ),
    _register("dendriteSharedCfg.posVmLimit", Span(0, loihi.CEILING_EXPONENT_LIMIT), "269, builder/discretize.py:364"),
    _register("dendriteSharedCfg.negVmLimit", Span(0, loihi.FLOOR_EXPONENT_LIMIT), "270, builder/discretize.py:362"),
    _unproven(
        "dendriteSharedCfg.noiseExp0, noiseMantOffset0, noiseAtDendOrVm (left unwritten)",
        Given("left as they are"),
        f"{_BUILDER}:271-273 writes them, noise or not; ours does not, as enableNoise is 0",
        "noise is added",
    ),
    _register("dendriteAccumCfg.delayBits", 3, "276", "spikes arrive in other steps"),
    _register(
        "cxCfg.bias",
        Span(1 - (1 << loihi.BIAS_BITS), (1 << loihi.BIAS_BITS) - 1),
        "306, builder/discretize.py:14, 105-112",
    ),
    _register(
        "cxCfg.biasExp", Span(0, loihi.BIAS_EXPONENT_LIMIT), "306, builder/discretize.py:15", unit="powers of two"
    ),
    _register("cxCfg.vthProfile", Span(0, loihi.CORE_THRESHOLDS - 1), "306, hardware/nxsdk_objects.py:8"),
    _register("cxCfg.cxProfile", Span(0, loihi.CORE_PROFILES - 1), "306, hardware/nxsdk_objects.py:7"),
    *(
        _register(f"cxMetaState.phase{i}", 2, "309-310 (2: the phase that integrates)")
        for i in range(loihi.UPDATE_GROUP)
    ),
    _register(
        "numUpdates.numUpdates", Span(0, loihi.CORE_COMPARTMENTS // loihi.UPDATE_GROUP), "283-285", unit="groups"
    ),
    _register("numUpdates.numStdp", 0, "286", "learning runs"),
    _register("dendriteTimeState.tepoch", 2, "289", "none known: it is about learning"),
    _register("timeState.tepoch", 2, "290", "none known: it is about learning"),
)
"""Compartments, and what a core shares."""

SYNAPSES: tuple[HardwareBelief, ...] = (
    _register(
        "synapseFmt.wgtExp",
        Span(-loihi.WEIGHT_EXPONENT_LIMIT, loihi.WEIGHT_EXPONENT_LIMIT),
        "131, builder/validate.py:103",
        unit="powers of two",
    ),
    HardwareBelief(
        "synapseFmt.wgtBits",
        "NxSDK, Loihi 1 core",
        "register",
        len(loihi.LOIHI_1_WEIGHT_BITS),
        "code of a width",
        "weights are read with other bits",
        f"{_BUILDER}:136, block.py:731 (8 bits)",
    ),
    _unproven(
        f"synapseFmt.wgtBits ({NARROW})",
        Span(1, len(loihi.LOIHI_1_WEIGHT_BITS) - 1),
        _NARROW,
        "weights are read with other bits; with --weight-bits 7 all have 8",
        NARROW,
    ),
    HardwareBelief(
        "widths of a weight, by wgtBits from 1 on",
        "NxSDK, Loihi 1 core",
        "arithmetic",
        loihi.LOIHI_1_WEIGHT_BITS,
        "bits",
        "weights are read with other bits",
        f"{NENGO}block.py:417",
        constants=("LOIHI_1_WEIGHT_BITS",),
    ),
    _register(
        "synapseFmt.idxBits", Span(1, len(loihi.LOIHI_1_INDEX_BITS)), "142, block.py:727-731", unit="code of a width"
    ),
    HardwareBelief(
        "widths of an index, by idxBits from 1 on",
        "NxSDK, Loihi 1 core",
        "arithmetic",
        loihi.LOIHI_1_INDEX_BITS,
        "bits",
        "rows need other memory",
        f"{NENGO}block.py:416",
        constants=("LOIHI_1_INDEX_BITS",),
    ),
    _register("synapseFmt.numSynapses", loihi.BLOCK_SYNAPSES - 1, "138, block.py:730", "rows need other memory"),
    _register(
        "synapseFmt.fanoutType",
        loihi.FANOUT_MIXED,
        "144, block.py:492, 729 (each weight has a sign)",
        "the sign of weights",
    ),
    _register("synapseFmt.compression", loihi.COMPRESSION_DENSE, "145, block.py:752 (with index bits)"),
    _unproven(
        f"synapseFmt.compression ({WITH_INDICES})",
        loihi.COMPRESSION_SPARSE,
        _INDEXED,
        "NxSDK refuses the network, or weights go to other neurons",
    ),
    _unproven(f"synapseFmt.idxBits ({DENSE})", 0, _DENSE, _DENSE_BREAKS, DENSE),
    *(
        _register(f"synapseFmt.{name}", 0, "129-147, block.py:441-461 (its defaults)", "weights learn or are late")
        for name in UNUSED_FIELDS
    ),
    _register("synapses.CIdx", Span(0, loihi.CORE_COMPARTMENTS - 1), "362-363", unit="compartment"),
    _register("synapses.Wgt", Span(-loihi.WEIGHT_LIMIT - 1, loihi.WEIGHT_LIMIT), "353, 364", unit="weight units"),
    _register("synapses.synFmtId", Span(1, loihi.CORE_FORMATS - 1), "365, 124-126 (0 stays unused)"),
    _register("synapses.LrnEn", 0, "366", "weights learn"),
    HardwareBelief(
        "Wgt with fewer bits: the upper ones",
        "NxSDK, Loihi 1 core",
        "arithmetic",
        Given("multiples of 2^(9 - bits), the sign being one of the bits"),
        "weight units",
        "weights lose their lowest bits, or are another power of two",
        None,
        f"{NENGO}block.py:512-514 has the shift, builder/discretize.py:473 rounds by it; no public program writes such "
        "weights to a board",
        rests=(f"Loihi 1: {NARROW}",),
    ),
    _register("synapseMap.synapsePtr", Span(0, 1 << 20), "381", unit="synapse"),
    _register("synapseMap.synapseLen", Span(1, loihi.CORE_COMPARTMENTS), "382", unit="synapses"),
    _register("synapseMap.discreteMapEntry.cxBase", 0, "385"),
)
"""Synapse formats, synapses and rows."""
