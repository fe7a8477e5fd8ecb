"""Loihi 2, and what Lava asks of it."""

from __future__ import annotations

from functools import partial

from lava_vpr.deploy.hardware.belief import BIAS_INPUT, LEARNING, LONG, Given, HardwareBelief, Span, of_constants
from lava_vpr.deploy.hardware.loihi_1 import LAVA
from lava_vpr.loihi import (
    BIAS_BITS,
    BIAS_EXPONENT_LIMIT,
    NO_MEMORY_DECAY,
    STATE_LIMIT,
    THRESHOLD_LIMIT,
    WEIGHT_BITS,
    WEIGHT_EXPONENT_LIMIT,
    WEIGHT_LIMIT,
)

LAVA_DL = "lava-dl at d825ac5, "
"""Where paths of lava-dl begin."""

BRIEF = "Intel Labs, Taking Neuromorphic Computing to the Next Level with Loihi 2, technology brief, 2021"
RESET_SHOWN = 32
"""The longest interval, in steps, at which public programs reset."""

_LIMITS = "fit says that maps are possible which the chip cannot hold"
_TESTS = f"{LAVA_DL}tests/lava/lib/dl/netx/test_hdf5_nx.py"
_chip = partial(of_constants, on="Loihi 2", kind="limit")
_var = partial(HardwareBelief, on="Lava's LIF on Loihi 2", kind="register")

CHIP: tuple[HardwareBelief, ...] = (
    _chip(
        "neuron cores of a Loihi 2",
        at="LOIHI_2_CORES",
        unit="cores",
        breaks=_LIMITS,
        source=f"{BRIEF}: 128 (chips with 120 exist)",
    ),
    _chip(
        "neurons of a Loihi 2 core",
        at="LOIHI_2_COMPARTMENTS",
        unit="neurons",
        breaks=_LIMITS,
        source=f"{BRIEF}: up to 8,192 a core, 1 million a chip",
    ),
    _chip(
        "synapses of a Loihi 2", at="LOIHI_2_SYNAPSES", unit="synapses", breaks=_LIMITS, source=f"{BRIEF}: 120 million"
    ),
    _chip(
        "memory of a Loihi 2 core",
        at="LOIHI_2_CORE_BYTES",
        unit="bytes",
        breaks=_LIMITS,
        source=f"{BRIEF}: 192 KB, flexible allocation",
    ),
    HardwareBelief(
        "how a Loihi 2 core's memory divides into synapses, axons and states",
        "Loihi 2",
        "limit",
        Given("unknown"),
        "bytes",
        "whether a map fits is said by Intel's compiler alone: fit names bounds, and promises nothing within them",
        why="no public text gives it; bounds count a weight's bits and nothing else",
        rests=("Loihi 2",),
    ),
    HardwareBelief(
        "steps between two resets of LIFReset",
        "Lava's LIFReset on Loihi 2",
        "register",
        Given("a power of two"),
        "steps",
        "states are not cleared between queries, or at other steps: every count is wrong",
        source=f'{LAVA_DL}tutorials/lava/lib/dl/netx/mnist/run.ipynb:306 ("has to be a power of 2"); 16 and 32 in its '
        "tests and tutorials",
    ),
    of_constants(
        "the longest interval between two resets",
        "Lava's LIFReset on Loihi 2",
        "limit",
        "LOIHI_2_RESET_LIMIT",
        "steps",
        "longer presentations are not cleared",
        why="public programs reset every 16 or 32 steps; no text has a limit",
        rests=(f"Loihi 2: {LONG}",),
    ),
    HardwareBelief(
        "step of the first reset (reset_offset)",
        "Lava's LIFReset on Loihi 2",
        "register",
        1,
        "steps",
        "states are cleared some steps early or late, within the silent steps or not",
        source=f"{LAVA_DL}tutorials/lava/lib/dl/netx/mnist/run.ipynb:327, {_TESTS[len(LAVA_DL) :]}:149",
    ),
)
"""The chip's limits, and how it clears states."""

LIF: tuple[HardwareBelief, ...] = (
    _var(
        "u",
        value=Span(1 - STATE_LIMIT, STATE_LIMIT - 1),
        unit="units of u",
        breaks="a state is cut off",
        source=f"{LAVA}proc/lif/models.py:100-102",
    ),
    _var(
        "v",
        value=Span(1 - STATE_LIMIT, STATE_LIMIT - 1),
        unit="units of v",
        breaks="a state is cut off",
        source=f"{LAVA}proc/lif/models.py:176-177",
    ),
    _var(
        "du",
        value=Span(0, NO_MEMORY_DECAY),
        unit="1/4096",
        breaks="a decay is cut off",
        source=f"{LAVA}proc/lif/models.py:249-253",
    ),
    _var(
        "dv",
        value=Span(0, NO_MEMORY_DECAY),
        unit="1/4096",
        breaks="a decay is cut off",
        source=f"{LAVA}proc/lif/models.py:249-253",
    ),
    _var(
        "vth",
        value=Span(0, THRESHOLD_LIMIT - 1),
        unit="64 units of v",
        breaks="a threshold is cut off",
        source=f"{LAVA}proc/lif/models.py:257",
    ),
    _var(
        "bias_mant",
        value=Span(-(1 << BIAS_BITS), (1 << BIAS_BITS) - 1),
        unit="2^bias_exp units of v",
        breaks="a bias is cut off",
        source=f"{LAVA}proc/lif/models.py:254",
    ),
    _var(
        "bias_exp",
        value=Span(0, BIAS_EXPONENT_LIMIT),
        unit="powers of two",
        breaks="a bias is cut off",
        source=f"{LAVA}proc/lif/models.py:256",
    ),
)
"""Vars of Lava's neurons by their names, and what they hold."""

SYNAPSES: tuple[HardwareBelief, ...] = (
    HardwareBelief(
        "num_weight_bits",
        "Lava's Dense and Sparse on Loihi 2",
        "register",
        Span(1, WEIGHT_BITS),
        "bits",
        "weights are cut off",
        source=f"{LAVA}proc/dense/models.py:83, utils/weightutils.py:206-241",
    ),
    HardwareBelief(
        "weight_exp",
        "Lava's Dense and Sparse on Loihi 2",
        "register",
        Span(-WEIGHT_EXPONENT_LIMIT, WEIGHT_EXPONENT_LIMIT),
        "powers of two",
        "weights are another power of two",
        why="nengo-loihi 1.1.0 has this range for Loihi 1; Lava checks none",
        rests=("Loihi 2",),
    ),
    HardwareBelief(
        "weights of sign mode EXCITATORY",
        "Lava's Dense and Sparse on Loihi 2",
        "register",
        Span(0, WEIGHT_LIMIT),
        "weight units",
        "weights are cut off",
        source=f"{LAVA}utils/weightutils.py:278-284",
    ),
    HardwareBelief(
        "weights of sign mode INHIBITORY",
        "Lava's Dense and Sparse on Loihi 2",
        "register",
        Span(-WEIGHT_LIMIT, 0),
        "weight units",
        "weights are cut off",
        source=f"{LAVA}utils/weightutils.py:108-111",
    ),
    HardwareBelief(
        "weights of sign mode MIXED",
        "Lava's Dense and Sparse on Loihi 2",
        "register",
        Span(-WEIGHT_LIMIT - 1, WEIGHT_LIMIT),
        "weight units",
        "weights are cut off",
        source=f"{LAVA}utils/weightutils.py:278-284",
    ),
    HardwareBelief(
        "num_message_bits",
        "Lava's Dense and Sparse on Loihi 2",
        "register",
        0,
        "bits",
        "spikes carry a value",
        source=f"{LAVA}proc/dense/process.py (0 is its default: binary spikes)",
    ),
    HardwareBelief(
        "Dense and LIFReset have models for the chip",
        "lava-loihi",
        "call",
        Given("found by Loihi2HwCfg"),
        None,
        "the network does not start: the host program sees it before the first query and says so",
        source=f"{_TESTS}:40-133 (run with Loihi2HwCfg on a board)",
    ),
    HardwareBelief(
        "LIF has a model for the chip",
        "lava-loihi",
        "call",
        Given("found by Loihi2HwCfg"),
        None,
        "inputs that integrate a bias do not start: the host program sees it before the first query and says so",
        source='lava-nc issue #829 ("The Loihi 2 process model for LIF", which scales its parameters)',
    ),
    HardwareBelief(
        "Sparse has a model for the chip",
        "lava-loihi",
        "call",
        Given("found by Loihi2HwCfg"),
        None,
        "the network does not start: the host program sees it before the first query and says so",
        source='lava-nc issue #436 (closed: "Implement NcVar for scipy.csr_matrix") and pull request #672; '
        "lava-optimization at 609342b, src/lava/lib/optimization/solvers/generic/solver.py imports NcModelSparse from "
        "lava.proc.sparse.ncmodel",
    ),
    HardwareBelief(
        "LearningDense has a model for the chip",
        "lava-loihi",
        "call",
        Given("found by Loihi2HwCfg"),
        None,
        "the network that learns does not start",
        source='lava-nc pull request #528 ("to enable 2F on-chip learning for Lava-Loihi") and issue #658, by which '
        "LearningDense is to work in hardware, too",
    ),
    HardwareBelief(
        "LearningDense with LIFReset runs on the chip",
        "lava-loihi",
        "call",
        Given("found by Loihi2HwCfg"),
        None,
        "the network that learns does not start",
        why="no public text shows the two together on a board, and lava-nc pull request #528, which prepared learning "
        "there, brought a LearningLIF; bundles hold the network, no program starts it there",
        rests=(f"Loihi 2: {LEARNING}",),
    ),
    of_constants(
        "largest trace of a learning rule",
        "Loihi 2",
        "arithmetic",
        "TRACE_LIMIT",
        None,
        "weights learned on the chip differ",
        source=f"{LAVA}magma/core/learning/constants.py:44",
    ),
    of_constants(
        "mantissas and exponents of a learning rule's products",
        "Loihi 2",
        "arithmetic",
        "PRODUCT_MANTISSAS PRODUCT_EXPONENTS",
        None,
        "the rule is refused, or learns at another rate",
        source=f"{LAVA}magma/core/learning/constants.py:52 (4 bits), learning_rule.py",
    ),
)
"""Lava's synapses, and learning."""

INPUT: tuple[HardwareBelief, ...] = (
    HardwareBelief(
        "inputs are LIF that integrate bias_mant",
        "Lava's LIF on Loihi 2",
        "call",
        Given("biases that are set before the first step"),
        None,
        "nothing spikes, or at other rates",
        source=f"{_TESTS}:49-51, 103-104",
    ),
    HardwareBelief(
        "bias_mant, bias_exp and v are written while the run is paused",
        "Lava's LIF on Loihi 2",
        "call",
        Given("Var.set between two calls of run"),
        None,
        "the second query is shown the first's image",
        why=f"Lava's runtime has the call for any Var ({LAVA}magma/runtime/runtime.py:545), and {_TESTS}:111-114 reads "
        "Vars of the chip; no public program writes them there",
        rests=(f"Loihi 2: {BIAS_INPUT}",),
    ),
    HardwareBelief(
        "spikes are injected from Python, one step after the other, by PyToNxAdapter",
        "lava.proc.embedded_io.spike of lava-loihi",
        "call",
        Given("PyToNxAdapter(shape)"),
        None,
        "nothing spikes; or, as each step waits for Python, a query takes milliseconds",
        source=f"{LAVA_DL}tutorials/lava/lib/dl/netx/oxford/utils.py:94, mnist/utils.py:60",
    ),
    HardwareBelief(
        "spikes are read out in Python by NxToPyAdapter",
        "lava.proc.embedded_io.spike of lava-loihi",
        "call",
        Given("NxToPyAdapter(shape)"),
        None,
        "no counts",
        source=f"{_TESTS}:46; {LAVA}networks/gradedvecnetwork.py:99",
    ),
    HardwareBelief(
        "where lava-loihi is installed",
        "lava-loihi",
        "call",
        Given("lava.utils.loihi2_profiler can be found"),
        None,
        "the host program says that lava-loihi is missing, though it is there",
        source=f"{LAVA}utils/loihi.py:108-121",
    ),
    HardwareBelief(
        "which host has the board",
        "lava-loihi",
        "call",
        Given("environment variables SLURM=1 or NXSDKHOST=ADDRESS"),
        None,
        "the host program says that no host is configured",
        source=f"{LAVA}utils/slurm.py:25, utils/loihi.py:100",
    ),
    HardwareBelief(
        "power and time of a run",
        "lava.utils.loihi2_profiler of lava-loihi",
        "call",
        Given("Loihi2Power(num_steps), Loihi2ExecutionTime(); total_power, static_total_power, avg_time_per_step"),
        "W, us",
        "no figures of the board",
        source=f"{LAVA_DL}tutorials/lava/lib/dl/netx/pilotnet_sdnn/benchmark.ipynb:177-385",
    ),
    HardwareBelief(
        "Loihi2ExecutionTime takes t_start, t_end, buffer_size, bin_size",
        "lava.utils.loihi2_profiler of lava-loihi",
        "call",
        Given("t_start=1, t_end=steps, buffer_size=1024, bin_size=steps / 1024"),
        "steps",
        "bench --backend loihi2 has no time",
        why="public programs pass buffer_size (lava-optimization's solver benchmark) or nothing; the other three stand "
        "in a comment of one of them",
    ),
)
"""How inputs, read-out and measurements are asked of Lava."""
