"""Calls of NxSDK that the host program of Kapoho Bay makes, and what its embedded program reads and writes."""

from __future__ import annotations

from functools import partial

from lava_vpr.deploy.hardware.belief import Belief, Given, of_constants
from lava_vpr.deploy.hardware.loihi_1 import NENGO

MODELS = "intel-nrc-ecosystem/models at 3dc53bf, nxsdk_modules_contrib/"
"""Where paths of that repository begin."""

_START = "the host program stops before the first query, and says which call NxSDK refused"
_IO = f"{NENGO}hardware/snips/nengo_io.c.template"


def _call(name: str, form: str, breaks: str, source: str | None, why: str | None = None, on: str = "NxSDK") -> Belief:
    """A call in the form in which it is made."""
    return Belief(name, on, "call", Given(form), None, breaks, source, why)


_embedded = partial(_call, on="NxSDK, embedded processor")


HOST: tuple[Belief, ...] = (
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
        "combra-lab/spiking-ddpg-mapless-navigation, README.md",
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
    Belief(
        "spike counters of a chip",
        "NxSDK",
        "limit",
        512,
        "counters",
        "nothing: neurons are counted by compartments; NxSDK refuses probes beyond it",
        None,
        "that they are limited is public (nengo-loihi pull request #281), the number is not; pcritical reads 512 on "
        "one chip, pelenet's snip has a loop over 4,500 (snips/readspikes.c:20)",
    ),
    _call(
        "createSnip",
        "createSnip(name, cFilePath, includeDir, funcName, guardName, phase=Phase.EMBEDDED_MGMT, lmtId=0, chipId)",
        _START,
        f"{MODELS}pelenet/pelenet/network/snips.py:25-33; {NENGO}hardware/interface.py:606-613",
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
        f"{MODELS}pelenet/pelenet/network/snips.py:50, pcritical/modules/pcritical.py:576",
    ),
    _call(
        "channel.write, channel.read",
        "write(messages, flat list of words), read(messages)",
        "no packet arrives: the host program says so",
        f"{MODELS}spytorch2loihi/ioProcess/ioProcess.py:326, 420; pcritical/modules/pcritical.py:245",
    ),
    _call(
        "channel.probe",
        "probe(), true where a message is there; used only where there is such a method",
        "the host program waits without a time limit of its own",
        None,
        "no public program of Loihi 1 calls it",
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

POWER: tuple[Belief, ...] = (
    _call(
        "power probe",
        "board.probe(ProbeParameter.ENERGY, PerformanceProbeCondition(tStart, tEnd, bufferSize, binSize))",
        "--power gives nothing, and says so",
        f"{MODELS}pcritical/modules/pcritical.py:176-183 (nengo-loihi issue #292 reports an error with N2Board)",
    ),
    _call(
        "steps of a bin of the power probe",
        "a power of two",
        "--power gives nothing",
        f"{MODELS}pcritical/modules/pcritical.py:182; spytorch2loihi_import_energy-delay.ipynb:157 (64)",
    ),
    _call(
        "measuring begins at step 1",
        "tStart=1",
        "power includes the warming up of the first buffer",
        f"{MODELS}pcritical/modules/pcritical.py:179; spytorch2loihi_import_energy-delay.ipynb:159 starts later",
    ),
    _call(
        "power of a run",
        "board.energyTimeMonitor.powerProfileStats: timePerTimestep; power['total'], ['static'], ['dynamic'], ['idle']",
        "--power says that nothing was measured",
        f"{MODELS}spytorch2loihi/spytorch2loihi_import_energy-delay.ipynb:578-582 (idle and static are two)",
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

EMBEDDED: tuple[Belief, ...] = (
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
        f"{MODELS}pelenet/pelenet/snips/reset.c:31-48",
    ),
    _embedded(
        "phases and accumulators stay as they are when states are cleared",
        "cx_meta_state and dendrite_accum are not written",
        "a neuron stays in another phase: counts differ, which the self-test finds",
        None,
        "public reset programs clear both (intel-nrc-ecosystem/models, "
        "nxsdk_modules_ncl/dnn/snips/reset_model_states/snip_reset.c:88-100); "
        "here nothing is in flight and nothing is refractory when states are cleared",
    ),
    _embedded(
        "cx_cfg, written",
        "core->cx_cfg[i].Bias and .BiasExp, the other fields as read",
        "inputs spike at other rates, which the self-test finds",
        f"{MODELS}spytorch2loihi/ioProcess/ioSnips/iomgmt.c:80-81, 193-194",
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
        f"{_IO}:21, 37, 80; {MODELS}pcritical/modules/snips/runmgmt.c:12-14",
    ),
    _embedded(
        "words of a message",
        "64 words of 32 bits, a message",
        "no packet arrives",
        f"{NENGO}hardware/interface.py:287-289",
    ),
)
"""What the embedded program does."""

CALLS: tuple[Belief, ...] = HOST + POWER + EMBEDDED
