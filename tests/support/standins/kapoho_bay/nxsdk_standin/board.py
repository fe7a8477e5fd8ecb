"""The board: built, connected, started, run and let go in the order that NxSDK wants."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

from nxsdk.api.enums.api_enums import ProbeParameter
from nxsdk.graph.monitor.probes import PerformanceProbeCondition
from nxsdk.graph.processes.phase_enums import Phase

from nxsdk_standin.channels import Channel, Traffic
from nxsdk_standin.cores import Chip
from nxsdk_standin.faults import FAULTS, StandinError
from nxsdk_standin.simulation import Machine, check_axons
from nxsdk_standin.snips import Snip

FOREVER = 3600.0


class Executor:
    """Says whether the board runs."""

    def __init__(self) -> None:
        self.started = False

    def hasStarted(self) -> bool:
        """As nengo-loihi asks."""
        return self.started


class N2Board:
    """A board of chips."""

    def __init__(
        self, board_id: int, n_chips: int, n_cores_per_chip: list[int], n_synapses_per_core: list[list[int]]
    ) -> None:
        if len(n_cores_per_chip) != n_chips or [len(row) for row in n_synapses_per_core] != n_cores_per_chip:
            raise StandinError(f"N2Board({board_id}, {n_chips}, {n_cores_per_chip}, ..): the sizes do not agree")
        if not 1 <= n_chips <= 2 or max(n_cores_per_chip) > 128:
            raise StandinError("Kapoho Bay has two chips of 128 cores")
        self.n2Chips = [Chip(i, row) for i, row in enumerate(n_synapses_per_core)]
        self.executor = Executor()
        self.snips: list[Snip] = []
        self.channels: list[Channel] = []
        self.traffic = Traffic()
        self.attempts = 0
        self.thread: threading.Thread | None = None
        self.measured = 0
        self.energyTimeMonitor: Any = None
        self.machine: Machine | None = None

    def probe(self, probeType: ProbeParameter, probeCondition: PerformanceProbeCondition) -> None:
        """Measure energy from the first step on."""
        if probeType is not ProbeParameter.ENERGY or self.attempts:
            raise StandinError(f"probe({probeType}) after the board has started")
        self.measured = probeCondition.tEnd

    def createSnip(self, **given: Any) -> Snip:
        """An embedded program."""
        wanted = {"name", "cFilePath", "includeDir", "funcName", "guardName", "phase", "lmtId", "chipId"}
        if set(given) != wanted or given["phase"] is not Phase.EMBEDDED_MGMT or given["lmtId"] != 0 or self.attempts:
            raise StandinError(f"createSnip({given})")
        chips = [chip for chip in self.n2Chips if chip.id == given["chipId"]]
        if not chips or any(snip.chip is chips[0] or snip.name == given["name"] for snip in self.snips):
            raise StandinError(f"createSnip: no chip {given['chipId']}, or it has a program")
        paths = (given["cFilePath"], given["includeDir"], given["funcName"], given["guardName"])
        self.snips.append(Snip(chips[0], given["name"], *paths))
        return self.snips[-1]

    def createChannel(self, name: bytes, numElements: int, messageSize: int, slack: int) -> Channel:
        """A channel."""
        made = Channel(self.traffic, name, numElements, messageSize, slack)
        if any(channel.name == made.name for channel in self.channels) or self.attempts:
            raise StandinError(f"channel {made.name} exists already, or the board has started")
        self.channels.append(made)
        return made

    def start(self) -> None:
        """Load everything onto the board."""
        FAULTS.note("start")
        self.attempts += 1
        if FAULTS.start_hangs:
            time.sleep(FOREVER)
        if self.attempts <= FAULTS.start_fails:
            raise ConnectionError("no board answers")
        if self.executor.started:
            raise StandinError("the board is started twice")
        for channel in self.channels:
            if channel.snip not in self.snips:
                raise StandinError(f"channel {channel.name} is not connected")
            channel.snip.channels.append(channel)
        networks = [core.network for chip in self.n2Chips for core in chip.n2CoresAsList if core.used]
        if not networks or not self.snips:
            raise StandinError("there is nothing to run")
        check_axons(self.n2Chips)
        for snip in self.snips:
            snip.compile()
        self.machine = Machine(self)
        self.executor.started = self.traffic.open = True

    def run(self, numSteps: int, aSync: bool = False) -> None:
        """Begin to run."""
        FAULTS.note(f"run {numSteps}")
        self.traffic.check()
        if not self.executor.started or self.thread is not None or not aSync:
            raise StandinError("run() before start() or finishRun(), or it would not return")
        if self.measured not in (0, numSteps):
            raise StandinError(f"{self.measured} steps are to be measured, but {numSteps} are run")
        self.thread = threading.Thread(target=self._run, args=(numSteps,), daemon=True)
        self.thread.start()

    def _run(self, steps: int) -> None:
        try:
            with ThreadPoolExecutor(max(1, len(self.snips))) as pool:
                for _ in range(steps):
                    self.machine.step(lambda at: list(pool.map(lambda snip: self._call(snip, at), self.snips)))
        except BaseException as error:
            self.traffic.stop(error)

    def _call(self, snip: Snip, step: int) -> None:
        """Run a program; if it fails, the others shall not wait for ever."""
        try:
            snip.run(step)
        except BaseException as error:
            self.traffic.stop(error)
            raise

    def finishRun(self) -> None:
        """Wait for the end."""
        if self.thread is None:
            raise StandinError("finishRun() without run()")
        if FAULTS.never_finishes:
            time.sleep(FOREVER)
        self.thread.join()
        self.thread = None
        self.traffic.check()
        if any(channel.messages for channel in self.channels):
            raise StandinError("packets are left in a channel after the run")
        FAULTS.note("finished")

    def disconnect(self) -> None:
        """Let go of the board."""
        FAULTS.note("disconnect")
        if self.measured and FAULTS.sensors:
            power = {"total": 950.0, "idle": 900.0, "static": 890.0, "dynamic": 50.0}
            stats = SimpleNamespace(timePerTimestep=12.5, power=power)
            self.energyTimeMonitor = SimpleNamespace(powerProfileStats=stats)
        self.executor.started = self.traffic.open = False
        self.traffic.stop(ConnectionError("disconnected"))  # programs that wait for a packet end
