"""One chip's embedded processor: its program, and the channels to and from it."""

import time
from typing import Any

import numpy as np

from board_input import Query
from chip_program import channel_names, write_program
from packets import (
    BEGIN,
    BIAS,
    CHUNK,
    COUNTS,
    FAULT,
    FAULTS,
    FIRST,
    KIND,
    LENGTH,
    MAGIC,
    MESSAGE_BYTES,
    PAYLOAD,
    READY,
    ROOM,
    SECOND,
    SET,
    SLACK,
    SPIKES,
    SUM,
    WORDS,
    checksums,
    packed,
    pieces,
)
from refusals import Refused


class Link:
    """One chip's embedded processor: its program, and the channels to and from it."""

    def __init__(self, device: Any, chip: int) -> None:
        self.device, self.network, self.chip = device, device.network, chip
        self.neurons = np.flatnonzero(self.network.exc[:, 0] == chip)
        self.sources = int((self.network.sources[:, 0] == chip).sum())
        source, folder = write_program(self.network, chip, lambda core: int(device.core(chip, core).id), device.folder)
        snip = device.board.createSnip(
            name=f"lava_vpr_{chip}",
            cFilePath=source,
            includeDir=folder,
            funcName="lava_vpr_manage",
            guardName="lava_vpr_guard",
            phase=device.phase.EMBEDDED_MGMT,
            lmtId=0,
            chipId=device.board.n2Chips[chip].id,
        )
        ways = self.network.ways
        each = WORDS if "one-word" in ways else 1  # messages of a packet
        self.counted = WORDS if "count-words" in ways else each  # what NxSDK counts of a packet
        size = {"numElements": WORDS, "messageSize": MESSAGE_BYTES // each, "slack": SLACK * each}
        made = [device.board.createChannel(name.encode(), **size) for name in channel_names(chip)]
        self.channel, self.back = made
        self.channel.connect(None, snip)
        self.back.connect(snip, None)

    def _send(self, kind: int, query: int, first_number: int, payloads: list, words: tuple = (0, 0)) -> None:
        """A packet for each of ``payloads``, numbered from ``first_number``."""
        numbers = range(first_number, first_number + len(payloads))
        packets = packed((kind, self.device.run_number, query), numbers, payloads, words)
        if len(packets):
            self.channel.write(len(packets) * self.counted, packets.reshape(-1).tolist())

    def begin(self, queries: int, first: int) -> None:
        """Announce a run."""
        self._send(BEGIN, 0, 0, [[self.network.fingerprint]], (queries, first))

    def send_settings(self, query: Query, number: int) -> None:
        """Bias and membrane of every input compartment of this chip."""
        words = query.settings[self.chip]
        self._send(SET, number, 0, [piece.reshape(-1) for piece in pieces(words, ROOM // 2)])

    def send_biases(self, query: Query, number: int) -> None:
        """Bias of every excitatory neuron of this chip."""
        self._send(BIAS, number, 0, pieces(query.biases[self.chip], ROOM))

    def send_spikes(self, query: Query, number: int, step: int) -> None:
        """Input spikes of the steps from ``step`` on."""
        steps = range(step, min(step + CHUNK, self.network.steps))
        self._send(SPIKES, number, step, [np.flatnonzero(query.spikes[self.chip][t]) for t in steps])

    def expect(self, kind: int, query: int, number: int, deadline: float) -> np.ndarray:
        """The next packet from the chip.

        Raises:
            Refused: none comes, or another than this one.
        """
        where = f"query {query - 1}, chip {self.chip}"
        while hasattr(self.back, "probe") and not self.back.probe():
            if time.monotonic() > deadline:
                raise Refused("run", f"{where}: the chip does not answer in time; a packet was lost, or it stopped")
            time.sleep(0.0002)
        packet = np.array(self.back.read(self.counted), dtype=np.int64).astype(np.int32)
        if packet.shape != (WORDS,) or packet[SUM] != checksums(packet[None])[0]:
            raise Refused("run", f"{where}: a packet from the chip is damaged")
        if packet[KIND] == MAGIC + FAULT:
            fault, step, wanted, got = packet[PAYLOAD : PAYLOAD + 4].tolist()
            text = FAULTS[fault] if 0 < fault < len(FAULTS) else str(fault)
            if text == "count":
                raise Refused("run", f"{where}: a counter holds {got}, which is no count of spikes of {wanted} each")
            raise Refused("run", f"{where}: in step {step} a packet came with {text} {got} instead of {wanted}")
        wanted = [MAGIC + kind, self.device.run_number, query, number]
        if packet[:LENGTH].tolist() != wanted:
            raise Refused("run", f"{where}: expected packet {wanted}, the chip sent {packet[:LENGTH].tolist()}")
        if kind == READY and packet[FIRST:SUM].tolist() != [len(self.neurons), self.sources]:
            raise Refused("run", f"{where}: the chip has another program than this bundle's")
        return packet

    def counts(self, query: Query, number: int, deadline: float) -> np.ndarray:
        """Spike counts of this chip's excitatory neurons at the end of a query.

        Raises:
            Refused: they are not all there, or not those of this query.
        """
        length = self.network.steps + self.network.silent
        sent = self.sources if self.network.bias_input else int(query.spikes[self.chip].sum())
        sent += len(self.neurons) * self.network.adapted
        found = []
        for block in range(max(1, -(-len(self.neurons) // ROOM))):
            packet = self.expect(COUNTS, number, block, deadline)
            if packet[FIRST] != length or packet[SECOND] != sent:
                took = f"{packet[SECOND]} of {sent} values after {packet[FIRST]} of {length} steps"
                raise Refused("run", f"query {number - 1}, chip {self.chip}: the chip took {took}")
            found.append(packet[PAYLOAD : PAYLOAD + packet[LENGTH]])
        counts = np.concatenate(found)
        if len(counts) != len(self.neurons) or (counts < 0).any() or (counts > length).any():
            raise Refused("run", f"query {number - 1}, chip {self.chip}: impossible spike counts")
        return counts
