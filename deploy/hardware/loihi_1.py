"""Loihi 1: limits of a core, the chip's arithmetic, and Kapoho Bay."""

from __future__ import annotations

from functools import partial

from lava_vpr.deploy.hardware.belief import Given, HardwareBelief, of_constants

NENGO = "nengo-loihi 1.1.0 (tag v1.1.0), nengo_loihi/"
"""Where paths of nengo-loihi begin."""

LAVA = "lava-nc 0.10, src/lava/"
"""Where paths of Lava begin."""

DAVIES = "Davies et al., IEEE Micro 38(1), 2018, doi 10.1109/MM.2018.112130359"
_NO_FIT = "networks are placed that the board cannot hold, or refused that it could"
_core = partial(of_constants, on="Loihi 1 core", kind="limit")
_sums = partial(of_constants, on="Loihi 1", kind="arithmetic")

CORE: tuple[HardwareBelief, ...] = (
    _core(
        "compartments of a core",
        at="CORE_COMPARTMENTS",
        unit="compartments",
        breaks=_NO_FIT,
        source=f"{NENGO}block.py:8",
    ),
    _core(
        "input axons of a core; output axons, too",
        at="CORE_AXONS",
        unit="axons",
        breaks=_NO_FIT,
        source=f"{NENGO}block.py:9-10",
    ),
    _core(
        "words of synapse memory of a core",
        at="CORE_SYNAPSE_WORDS",
        unit="words of 64 bits",
        breaks=_NO_FIT,
        source=f"{NENGO}block.py:11",
    ),
    _core(
        "bits of a word of synapse memory", at="WORD_BITS", unit="bits", breaks=_NO_FIT, source=f"{NENGO}block.py:11"
    ),
    _core(
        "synapse memory that plans leave free",
        at="SYNAPSE_SLACK",
        unit="share of a core's words",
        breaks="if NxSDK's packing needs more, it refuses the network; if it needs none, cores are wasted",
        why=f"nobody has published a core filled to the last word; {NENGO}builder/validate.py:52 allows it",
        rests=("Loihi 1",),
    ),
    _core(
        "synapses of a block of synapse memory",
        at="BLOCK_SYNAPSES",
        unit="synapses",
        breaks=_NO_FIT,
        source=f"{NENGO}block.py:530, 730",
    ),
    _core(
        "bits before the synapses of a block",
        at="BLOCK_HEADER_BITS",
        unit="bits",
        breaks=_NO_FIT,
        source=f"{NENGO}block.py:526-527",
    ),
    HardwareBelief(
        "order of the fields in a synapse word",
        "Loihi 1 core",
        "arithmetic",
        Given("format, number of synapses, then index and weight of each, least significant bit first"),
        None,
        "nothing on a board: NxSDK packs words itself, synapse by synapse; words in a bundle prove sizes",
        why="it is not public; ours is one of many",
    ),
    _core(
        "distinct pairs of decays of a core",
        at="CORE_PROFILES",
        unit="profiles",
        breaks="nothing: five are used at most",
        source=f"{NENGO}hardware/validate.py:19, hardware/nxsdk_objects.py:7",
    ),
    _core(
        "distinct thresholds of a core",
        at="CORE_THRESHOLDS",
        unit="thresholds",
        breaks="nothing: five are used at most",
        source=f"{NENGO}hardware/nxsdk_objects.py:8 (16 in hardware/validate.py:20)",
    ),
    _core(
        "synapse formats of a core, number 0 unused",
        at="CORE_FORMATS",
        unit="formats",
        breaks="nothing: six are used at most",
        source=f"{NENGO}hardware/validate.py:21 (8 in hardware/nxsdk_objects.py:9)",
    ),
    _core(
        "compartments that are updated together",
        at="UPDATE_GROUP",
        unit="compartments",
        breaks="compartments beyond numUpdates stand still",
        source=f"{NENGO}hardware/builder.py:283",
    ),
    of_constants(
        "chips of Kapoho Bay",
        "Kapoho Bay",
        "limit",
        "KAPOHO_BAY_CHIPS",
        "chips",
        _NO_FIT,
        source=f"{NENGO}hardware/interface.py:56, 71 (its default); Intel's description of the board",
    ),
    of_constants("neuron cores of a chip", "Loihi 1", "limit", "LOIHI_1_CORES", "cores", _NO_FIT, source=DAVIES),
    of_constants(
        "cores of a tile; columns and rows of the mesh",
        "Loihi 1",
        "limit",
        "TILE_CORES MESH_COLUMNS MESH_ROWS",
        "cores, tiles",
        "modelled hops, and which core is near which",
        source="SANA-FE 2.2.9, arch/loihi.yaml",
    ),
)
"""What a core, a chip and the board hold."""

ARITHMETIC: tuple[HardwareBelief, ...] = (
    _sums(
        "bits of current u and membrane v, sign included",
        at="STATE_BITS",
        unit="bits",
        breaks="spikes differ from the host's where a state is large",
        source=f"{LAVA}proc/lif/models.py:100-102; {NENGO}builder/discretize.py:21",
    ),
    _sums(
        "u wraps beyond, v is clipped to this less 1",
        at="STATE_LIMIT",
        unit="units of u",
        breaks="spikes differ from the host's where a state is large",
        source=f"{LAVA}proc/lif/models.py:162-177; {NENGO}emulator/interface.py:316, 326",
    ),
    _sums(
        "bits by which weights and thresholds are shifted",
        at="INPUT_SHIFT",
        unit="bits",
        breaks="all spikes",
        source=f"{LAVA}proc/lif/models.py:106, 273; {NENGO}block.py:485",
    ),
    _sums(
        "sum of the weights of one step, on Loihi 1",
        at="LOIHI_1_INPUT_LIMIT",
        unit="weight units",
        breaks="an accumulator overflows, and a neuron spikes or is silent by mistake",
        source=f"{NENGO}builder/discretize.py:19, emulator/interface.py:313 (21 bits and sign, an emulator's)",
    ),
    _sums(
        "sum of the weights of one step, by u alone",
        at="INPUT_LIMIT",
        unit="weight units",
        breaks="u wraps, and a neuron spikes or is silent by mistake",
        source=f"{LAVA}proc/lif/models.py:162-168",
    ),
    _sums(
        "threshold mantissas stay below",
        at="THRESHOLD_LIMIT",
        unit="64 units of v",
        breaks="a threshold is cut off",
        source=f"{NENGO}builder/discretize.py:10, hardware/validate.py:53-54",
    ),
    _sums(
        "bits of a decay; the decay that leaves nothing; the register that leaves no current",
        at="DECAY_BITS DECAY_UNITY NO_MEMORY_DECAY",
        unit="bits, 1/4096",
        breaks="membranes leak otherwise than on the host; a current outlives its step",
        source=f"{LAVA}proc/lif/models.py:89-104, 145; {NENGO}builder/discretize.py:120",
    ),
    _sums(
        "bits of a weight; the largest; the largest of a synapse with a sign in as many bits",
        at="WEIGHT_BITS WEIGHT_LIMIT SIGNED_WEIGHT_LIMIT",
        unit="bits, weight units",
        breaks="weights are cut off",
        source=f"{LAVA}proc/dense/models.py:83-90; {NENGO}hardware/builder.py:353, builder/discretize.py:473-476",
    ),
    _sums(
        "exponents of synapses, either sign",
        at="WEIGHT_EXPONENT_LIMIT",
        unit="powers of two",
        breaks="weights are another power of two",
        source=f"{NENGO}builder/validate.py:103",
    ),
    _sums(
        "bits of a bias mantissa, besides its sign; the largest exponent",
        at="BIAS_BITS BIAS_EXPONENT_LIMIT",
        unit="bits, powers of two",
        breaks="biases are cut off: neurons and inputs spike at other rates",
        source=f"{NENGO}builder/discretize.py:14-15; {LAVA}proc/lif/models.py:254-256",
    ),
    _sums(
        "exponents k of floor and ceiling of v",
        at="FLOOR_EXPONENT_LIMIT CEILING_EXPONENT_LIMIT",
        unit="powers of two",
        breaks="membranes are clipped, and spikes differ",
        source=f"{NENGO}builder/discretize.py:362-365 (floor up to 31), hardware/builder.py:247-250",
    ),
    _sums(
        "the ceiling's exponent is 9 + 2 k",
        at="CEILING_EXPONENT_OFFSET CEILING_EXPONENT_STEP",
        unit="powers of two",
        breaks="membranes are clipped, and spikes differ",
        source=f"{NENGO}builder/discretize.py:364-365",
    ),
    HardwareBelief(
        "a neuron spikes when v is above its threshold, and v is 0 after",
        "Loihi 1",
        "arithmetic",
        Given("v > vth, strictly"),
        None,
        "neurons spike a step early",
        source=f"{LAVA}proc/lif/models.py:278; {NENGO}emulator/interface.py:330-331",
    ),
    HardwareBelief(
        "a membrane with decayV 0 keeps what it sums up",
        "Loihi 1",
        "arithmetic",
        Given("v' = v + u, whatever the steps between"),
        None,
        "counts are too small: counters forget, which the self-test finds",
        source=f"{NENGO}emulator/interface.py:326 (decay_int with a decay of 0), builder/discretize.py:364 (vmax)",
    ),
    HardwareBelief(
        "rounding of decays",
        "Loihi 1, Loihi 2",
        "arithmetic",
        Given("magnitude times (4096 - decay), shifted right by 12; u decays by one unit more"),
        None,
        "membranes drift from the host's by a unit a step",
        why=f"{LAVA}proc/lif/models.py:145-150 says so, but lava-nc issue #322 reports that the chip differs in u and "
        "in thresholds; here u has no memory",
        rests=("Loihi 1", "Loihi 2"),
    ),
)
"""How the chip counts."""
