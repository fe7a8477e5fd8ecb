"""Calls of NxSDK that the host program of Kapoho Bay makes, and what its embedded program reads and writes."""

from __future__ import annotations

from functools import partial

from lava_vpr.deploy.hardware.belief import BIAS_INPUT, Given, HardwareBelief, of_constants
from lava_vpr.deploy.hardware.loihi_1 import NENGO

MODELS = "intel-nrc-ecosystem/models at 3dc53bf, "
CONTRIB, LSNN = f"{MODELS}nxsdk_modules_contrib/", f"{MODELS}nxsdk_modules_ncl/lsnn/apps/"
"""Where paths of that repository begin."""

_START = "the host program stops before the first query, and says which call NxSDK refused"
_IO = f"{NENGO}hardware/snips/nengo_io.c.template"


def _call(
    name: str,
    form: str,
    breaks: str,
    source: str | None,
    why: str | None = None,
    on: str = "NxSDK",
    rests: tuple[str, ...] = (),
) -> HardwareBelief:
    """A call in the form in which it is made."""
    return HardwareBelief(name, on, "call", Given(form), None, breaks, source, why, rests=rests)


_embedded = partial(_call, on="NxSDK, embedded processor")


HOST: tuple[HardwareBelief, ...] = (
    _call("versions of NxSDK", "0.9 to 1.0", _START, f"{NENGO}hardware/interface.py:62-63"),
    _call(
        "where N2Board is",
        "nxsdk.arch.n2a.n2board (1.0), nxsdk.graph.nxboard (0.9)",
        _START,
        f"{NENGO}hardware/nxsdk_shim.py:67-70",
    ),
    _call(
        "which board",
        "environment variable KAPOHOBAY=1",
        _START,
        "combra-lab/spiking-ddpg-mapless-navigation at 00f394d, README.md:188",
    ),
    _call(
        "N2Board",
        "N2Board(board_id, chips, cores of each, synapses of each core)",
        _START,
        f"{NENGO}hardware/builder.py:32-34",
    ),
    _call(
        "chips and cores",
        "board.n2Chips[i].n2CoresAsList[j], each with an id",
        _START,
        f"{NENGO}hardware/builder.py:65-69, 423-424",
    ),
    _call(
        "createDiscreteAxon",
        "core.createDiscreteAxon(srcCxId, dstChipId, dstCoreId, dstSynMapId)",
        _START,
        f"{NENGO}hardware/builder.py:444-449",
    ),
    _call(
        "monitor.probe",
        'board.monitor.probe(core.cxState, compartments, "spike"), without a condition',
        "nothing: the host program makes no probes, whose number is limited",
        f"{NENGO}hardware/builder.py:511",
    ),
    HardwareBelief(
        "spike counters of a chip",
        "NxSDK",
        "limit",
        512,
        "counters",
        "nothing: neurons are counted by compartments; NxSDK refuses probes beyond it",
        None,
        "that they are limited is public (nengo-loihi pull request #281), the number is not; "
        f"{CONTRIB}pelenet/pelenet/snips/readspikes.c:20 has a loop over 4,500",
    ),
    _call(
        "createSnip",
        "createSnip(name, cFilePath, includeDir, funcName, guardName, phase=Phase.EMBEDDED_MGMT, lmtId=0, chipId)",
        _START,
        f"{CONTRIB}pelenet/pelenet/network/snips.py:25-33; {NENGO}hardware/interface.py:606-613",
    ),
    _call(
        "createChannel",
        "board.createChannel(name as bytes, numElements, messageSize in bytes, slack)",
        _START,
        f"{NENGO}hardware/interface.py:649-663",
    ),
    _call(
        "channel.connect to the host",
        "channel.connect(None, snip), channel.connect(snip, None)",
        _START,
        f"{CONTRIB}pelenet/pelenet/network/snips.py:50, pcritical/modules/pcritical.py:576",
    ),
    _call(
        "channel.read",
        "read(messages), a flat list of their words",
        "no packet arrives: the host program says so",
        f"{LSNN}seqmnist/seq_img_classifier.py:221-222, 295 (a message of 64 bytes is 16 integers)",
    ),
    _call(
        "channel.write of messages of several words",
        "write(messages, flat list of all their words)",
        "no packet arrives, or the first step waits for ever: the host program says so",
        None,
        f"public programs write messages of one word, as write(words, list of words) ({MODELS}"
        f"nxsdk_modules_ncl/epl/src/multi_pattern_learning/epl_snips_utils.py:186-191, {LSNN[len(MODELS) :]}"
        "seqmnist/seq_img_classifier.py:244-255); where one has messages of 16 words (214-216, 282), it gives the "
        "length of its list, not the number of messages",
        rests=("Loihi 1",),
    ),
    _call(
        "messages of one word, with --ways one-word",
        "createChannel(.., 4 bytes, ..), write(words, list of words)",
        "this way cures nothing",
        f"{MODELS}nxsdk_modules_ncl/epl/src/multi_pattern_learning/epl_snips_utils.py:186-191",
    ),
    _call(
        "channel.probe",
        "probe(), true where a message is there; used only where there is such a method",
        "the host program waits without a time limit of its own",
        None,
        "no public program of Loihi 1 calls it",
        rests=("Loihi 1",),
    ),
    of_constants(
        "words of a packet, and those that say what it is",
        "host program",
        "limit",
        "PACKET_WORDS PACKET_HEADER_WORDS",
        "words",
        "no packet arrives: the host program says so",
        source=f"{NENGO}hardware/interface.py:287-289, 649-663 (a channel's message may be of any size)",
    ),
    of_constants(
        "spikes that the host sends to a chip in one step",
        "host program",
        "limit",
        "HOST_SPIKES",
        "spikes",
        "models are refused that the chip could take: it is what a packet of ours holds, no limit of the chip",
        source=f"{NENGO}hardware/interface.py:70, docs/configuration.rst:53 (a setting there, 50 if unset; 300 shown)",
    ),
    _call("start", "board.start(), board.executor.hasStarted()", _START, f"{NENGO}hardware/interface.py:148, 181"),
    _call(
        "run",
        "board.run(steps, aSync=True), board.finishRun()",
        "the host program waits for ever before it sends anything; its watchdog ends it",
        f"{NENGO}hardware/interface.py:219, 226",
    ),
    _call(
        "disconnect",
        "board.disconnect()",
        "the board stays taken until the process ends",
        f"{NENGO}hardware/interface.py:162",
    ),
)
"""Calls from the host."""

POWER: tuple[HardwareBelief, ...] = (
    _call(
        "power probe",
        "board.probe(ProbeParameter.ENERGY, PerformanceProbeCondition(tStart, tEnd, bufferSize, binSize))",
        "--power gives nothing, and says so",
        f"{CONTRIB}pcritical/modules/pcritical.py:176-183 (nengo-loihi issue #292 reports an error with N2Board)",
    ),
    _call(
        "steps of a bin of the power probe",
        "a power of two",
        "--power gives nothing",
        f"{CONTRIB}pcritical/modules/pcritical.py:182; {LSNN}"
        "relnet/RelNet_bAbI_Loihi_performance_measurements.ipynb:792",
    ),
    _call(
        "measuring begins at step 1",
        "tStart=1",
        "power includes the warming up of the first buffer",
        f"{CONTRIB}pcritical/modules/pcritical.py:179",
    ),
    _call(
        "power of a run",
        "board.energyTimeMonitor.powerProfileStats: timePerTimestep; power['total'], ['static'], ['dynamic'], ['idle']",
        "--power says that nothing was measured",
        None,
        f"board.energyTimeMonitor.powerProfileStats is public ({CONTRIB}pcritical/modules/pcritical.py:188), these "
        "keys are not: programs read power['core'] and power['lakemont'], each with 'static' and 'dynamic' "
        f"({LSNN}relnet/RelNet_bAbI_Loihi_performance_measurements.ipynb:899-905, "
        "seqmnist/sMNIST_Loihi_performance_measurements.ipynb:310-316)",
    ),
    _call(
        "Kapoho Bay has sensors of power",
        "it measures",
        "--power says that nothing was measured",
        None,
        "public measurements are of Nahuku boards",
    ),
)
"""Measuring power and time."""

EMBEDDED: tuple[HardwareBelief, ...] = (
    _embedded(
        "NEURON_PTR", "NEURON_PTR((CoreId){.id = id}) -> NeuronCore *", "the program does not compile", f"{_IO}:39"
    ),
    _embedded(
        "cx_state",
        "core->cx_state[compartment].U and .V, read",
        "counts, or membranes, are others",
        f"{_IO}:210, 226",
    ),
    _embedded(
        "cx_state, written",
        "(CxState){.U = 0, .V = 0} into core->cx_state[i], then nx_flush_core(core)",
        "membranes are not cleared: queries mix, which the self-test finds",
        None,
        f"programs write whole cores by nx_fast_init64 and flush them ({CONTRIB}pelenet/pelenet/snips/reset.c:31-48), "
        "or V alone of one compartment, without a flush (wilkieolin/loihi_bandit at b53c071, management.c:100); none "
        "writes a CxState into one",
        rests=("Loihi 1",),
    ),
    _embedded(
        "cores are cleared as a whole, with --ways whole-cores or phases",
        "nx_fast_init64(core->cx_state, n, 0), nx_fast_init32(core->cx_meta_state, n / 4, MetaState), then a flush",
        "these ways cure nothing",
        f"{CONTRIB}pelenet/pelenet/snips/reset.c:34-60",
    ),
    HardwareBelief(
        "memory of an embedded processor",
        "Loihi 1, embedded processor",
        "limit",
        Given("unknown"),
        "bytes",
        "the program does not link or load: the ladder's rung of tables finds it, and tries --ways masks",
        None,
        "no public text gives it; fit says what the tables of the program take",
        rests=("Loihi 1",),
    ),
    _embedded(
        "phases and accumulators stay as they are when states are cleared",
        "cx_meta_state and dendrite_accum are not written",
        "a neuron stays in another phase: counts differ, which the self-test finds",
        None,
        f"public reset programs clear the one ({CONTRIB}pelenet/pelenet/snips/reset.c:60) or the other "
        "(biphasic/Quartz-on-Loihi at a56d551, quartz/snips/reset.c:36); here nothing is in flight and nothing is "
        "refractory when states are cleared",
        rests=("Loihi 1",),
    ),
    _embedded(
        "cx_cfg, written",
        "core->cx_cfg[i].Bias and .BiasExp, the other fields as read",
        "inputs spike at other rates, which the self-test finds; so do neurons whose biases queries bring",
        None,
        f"programs on the host write these fields of cxCfg ({NENGO}hardware/builder.py:306); no public one writes them "
        "on the chip",
        rests=(f"Loihi 1: {BIAS_INPUT}",),
    ),
    _embedded(
        "a spike is injected in the management phase",
        "nx_send_discrete_spike(time_step, core, axon), and arrives in the next step",
        "input spikes arrive a step early or late: counts differ, which the self-test finds",
        f"{_IO}:138, hardware/interface.py:612",
    ),
    _embedded(
        "channels",
        "getChannelID(name), readChannel(channel, words, messages), writeChannel(channel, words, messages)",
        "no packet arrives: the host program says so",
        f"{_IO}:42-43, 86, 241",
    ),
    _embedded(
        "the guard is asked and the program called after every step",
        "int guard(runState *), void run(runState *); runState.time_step counts from 1",
        "queries are shown in other steps: counts differ, which the self-test finds",
        f"{_IO}:21, 37, 80; {CONTRIB}pcritical/modules/snips/runmgmt.c:12-14",
    ),
    _embedded(
        "words of a message",
        "64 words of 32 bits, a message",
        "no packet arrives",
        f"{NENGO}hardware/interface.py:287-289",
    ),
)
"""What the embedded program does."""
