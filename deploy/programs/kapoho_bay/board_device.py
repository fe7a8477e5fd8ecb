"""The board: NxSDK's classes, the network's configuration, start, runs and end."""

import contextlib
import os
import re
import shutil
import sys
import tempfile
import threading
import time
import traceback

import numpy as np

import board_power
from board_link import Link
from board_network import Core, Network
from packets import CHUNK, READY
from refusals import Refused, told
from result_files import Results
from watchdog import GRACE, Watchdog

IDLE = 2  # phase in which a compartment integrates
ATTEMPTS, PAUSE, START_SECONDS = 3, 0.5, 120.0


def load_nxsdk() -> tuple:
    """NxSDK's classes N2Board and Phase.

    Raises:
        Refused: it is not here, or of another version.
    """
    source = "it is Intel's closed package, from its neuromorphic research community"
    try:
        import nxsdk  # type: ignore[import-not-found]
    except ImportError:
        raise Refused("missing", f"{sys.executable} has no nxsdk; {source}; use a Python that has it") from None
    except Exception as error:
        raise Refused("missing", f"nxsdk cannot be imported ({told(error)}); install it again") from None
    version = str(getattr(nxsdk, "__version__", "unknown"))
    numbers = re.match(r"(\d+)\.(\d+)", version)
    if numbers is None or not (0, 9) <= tuple(int(x) for x in numbers.groups()) <= (1, 0):
        raise Refused("missing", f"nxsdk {version} is installed, 0.9 to 1.0 is needed; {source}")
    try:
        try:
            from nxsdk.arch.n2a.n2board import N2Board  # type: ignore[import-not-found]  # 1.0
        except ImportError:
            from nxsdk.graph.nxboard import N2Board  # type: ignore[import-not-found]  # 0.9
        from nxsdk.graph.processes.phase_enums import Phase  # type: ignore[import-not-found]
    except ImportError as error:
        raise Refused("missing", f"nxsdk {version} is incomplete ({told(error)}); install it again") from None
    return N2Board, Phase


def check_environment() -> None:
    """NxSDK drives Kapoho Bay only if told so.

    Raises:
        Refused: it is not.
    """
    if os.environ.get("KAPOHOBAY") != "1":
        raise Refused(
            "missing",
            "KAPOHOBAY is not set, so NxSDK would look for another board; connect Kapoho Bay (lsusb must show it, and "
            "no kernel module such as ftdi_sio may hold it) and set the environment variable KAPOHOBAY=1",
        )


class Device:
    """The network on the board: configured when made, running after `start`."""

    def __init__(self, network: Network, power_steps: int = 0) -> None:
        board_class, self.phase = load_nxsdk()
        self.network, self.run_number = network, 0
        self.folder = tempfile.mkdtemp(prefix="kapoho-bay-")
        last = max(core.chip for core in network.cores)
        sizes = [[0] for _ in range(last + 1)]
        for core in network.cores:
            row = sizes[core.chip]
            row += [0] * (core.core + 1 - len(row))
            row[core.core] = core.synapses
        try:
            self.board = board_class(1, last + 1, [len(row) for row in sizes], sizes)
            for core in network.cores:
                self._configure(core)
            for core in network.cores:
                self._connect(core)
            if power_steps:
                board_power.attach(self.board, power_steps)
            self.links = [Link(self, chip) for chip in network.chips]
        except Refused:
            raise
        except Exception as error:
            text = f"NxSDK refuses the network ({told(error)}); its version may differ"
            raise Refused("missing", text, traceback.format_exc()) from None
        Watchdog.let_go = self.close

    def core(self, chip: int, core: int):  # type: ignore[no-untyped-def]
        """NxSDK's core."""
        return self.board.n2Chips[chip].n2CoresAsList[core]

    def _configure(self, core: Core) -> None:
        """Registers, compartments and synapses of one core."""
        own, registers = self.core(core.chip, core.core), core.registers
        for i, profile in enumerate(registers["cxProfileCfg"]):
            own.cxProfileCfg[i].configure(**profile)
        for i, threshold in enumerate(registers["vthProfileCfg"]):
            own.vthProfileCfg[i].staticCfg.configure(**threshold)
        for i, form in enumerate(registers["synapseFmt"]):
            if form and form["idxBits"] and "compression-3" in self.network.ways:
                form = dict(form, compression=3)
            for name, value in sorted((form or {}).items()):
                setattr(own.synapseFmt[i], name, value)
        own.dendriteSharedCfg.configure(**registers["dendriteSharedCfg"])
        own.dendriteAccumCfg.configure(delayBits=3)
        for i, (profile, threshold, bias, exponent) in enumerate(core.compartments.tolist()):
            own.cxCfg[i].configure(bias=bias, biasExp=exponent, vthProfile=threshold, cxProfile=profile)
            own.cxMetaState[i // 4].configure(**{f"phase{i % 4}": IDLE})
        for pointer, (form, compartments, weights) in zip(core.pointers, core.rows):  # noqa: B905 (3.6 lacks strict)
            for i, weight in enumerate(weights):
                own.synapses[pointer + i].configure(CIdx=compartments[i], Wgt=weight, synFmtId=form, LrnEn=0)
        for axon, row in enumerate(core.row_of_axon.reshape(-1).tolist()):
            own.synapseMap[axon].synapsePtr = core.pointers[row]
            own.synapseMap[axon].synapseLen = len(core.rows[row][1])
            own.synapseMap[axon].discreteMapEntry.configure(cxBase=0)
        own.numUpdates.configure(**registers["numUpdates"])
        own.dendriteTimeState[0].tepoch = 2
        own.timeState[0].tepoch = 2

    def _connect(self, core: Core) -> None:
        """Output axons of one core to others."""
        own = self.core(core.chip, core.core)
        for source, chip, target, axon in core.axons_out.tolist():
            own.createDiscreteAxon(
                srcCxId=source,
                dstChipId=self.board.n2Chips[chip].id,
                dstCoreId=self.core(chip, target).id,
                dstSynMapId=axon,
            )

    def start(self) -> None:
        """Start the board.

        Raises:
            Refused: it does not start, three times.
        """
        reason, details = "it does not say why", ""
        for attempt in range(ATTEMPTS):
            if attempt:
                time.sleep(PAUSE)
            try:
                with Watchdog(START_SECONDS, "start", f"the board did not start within {START_SECONDS:g} s"):
                    self.board.start()
                    if self.board.executor.hasStarted():
                        break
            except Exception as error:
                reason, details = told(error), traceback.format_exc()
        else:
            raise Refused(
                "start",
                f"the board did not start in {ATTEMPTS} attempts ({reason}); see that lsusb shows it, that no kernel "
                "module (ftdi_sio) holds it and that nobody else uses it",
                details,
            )

    def answer(self, queries: list, first: int, deadline: float, results: Results) -> None:
        """Present ``queries``, numbered from ``first``, in one run of the board."""
        network, self.run_number = self.network, self.run_number + 1
        self.board.run(2 + len(queries) * (network.steps + network.silent), aSync=True)
        for link in self.links:
            link.begin(len(queries), first)
        for link in self.links:
            link.expect(READY, first, 0, deadline)
        for number, query in enumerate(queries, first):
            if network.bias_input:
                for link in self.links:
                    link.send_settings(query, number)
            if network.adapted:
                for link in self.links:
                    link.send_biases(query, number)
            if not network.bias_input:
                for step in range(0, network.steps, CHUNK):  # chips step together: none may wait while another is sent
                    for link in self.links:
                        link.send_spikes(query, number, step)
            row = np.full(network.neurons, -1, np.int32)
            for link in self.links:
                row[link.neurons] = link.counts(query, number, deadline)
            results.put(number - 1, row)
        results.save()
        self.board.finishRun()

    def close(self) -> None:
        """Let go of the board, and of the folder with the chips' programs."""
        Watchdog.let_go = None
        thread = threading.Thread(target=self._disconnect, daemon=True)  # NxSDK may wait for ever
        thread.start()
        thread.join(GRACE)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _disconnect(self) -> None:
        with contextlib.suppress(Exception):
            self.board.disconnect()
