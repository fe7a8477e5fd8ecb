"""The network in the bundle as the board and this program need it: tables, registers, synapses unpacked."""

import re
from typing import FrozenSet

import numpy as np

from bundle_files import AGAIN, Bundle
from packets import ROOM
from refusals import Refused

WEIGHT_CODES, INDEX_CODES = (0, 1, 2, 3, 4, 5, 6, 8), (0, 6, 7, 8, 9, 10, 11, 12)
REGISTER_BITS = 9  # of a weight: 8 and sign
COUNTER_UNIT = 128  # what a spike adds to the membrane of its counter: a weight of 2, in units of 2^6


class Core:
    """What one core gets: registers, and its synapses unpacked from the 64-bit words."""

    def __init__(self, bundle: Bundle, folder: str) -> None:
        self.name = folder.split("/")[-1]
        self.chip, self.core = (int(text) for text in re.findall(r"\d+", self.name))
        self.registers = bundle.json(folder + "/registers.json")
        self.compartments = bundle.array(folder + "/compartments.npy")
        self.axons_out = bundle.array(folder + "/axons_out.npy")
        entries = bundle.array(folder + "/axons_in.npy")
        words = bundle.array(folder + "/synapses.npy")
        bits = np.unpackbits(words.astype("<u8").view(np.uint8), bitorder="little")
        # Axons that share a row share its synapses: each row is unpacked and configured once.
        rows, self.row_of_axon = np.unique(entries.reshape(-1, 3), axis=0, return_inverse=True)
        self.rows = [self._row(bits, *(int(x) for x in row)) for row in rows]
        sizes = [len(row[1]) for row in self.rows]
        self.pointers = [sum(sizes[:r]) for r in range(len(sizes))]
        self.synapses = sum(sizes)

    def _row(self, bits: np.ndarray, first: int, words: int, synapses: int) -> tuple:
        """Synapse format, compartments and register weights of one row.

        A block: 4 bits format, 6 bits synapses less 1, then for each synapse index bits (none if dense) and weight
        bits, least significant first, to the end of a word.
        """
        at, compartments, weights, number = 64 * first, [], [], 0  # type: int, list, list, int
        formats = self.registers["synapseFmt"]
        while len(weights) < synapses:
            number, count = _value(bits[at : at + 4]), _value(bits[at + 4 : at + 10]) + 1
            form = formats[number] if number < len(formats) else None
            if form is None or at + 10 > 64 * (first + words):
                raise Refused("bundle", self.name + ": a row of synapses does not fit its words; " + AGAIN)
            index_bits, weight_bits = INDEX_CODES[form["idxBits"]], WEIGHT_CODES[form["wgtBits"]]
            end = at + 10 + count * (index_bits + weight_bits)
            if end > 64 * (first + words):
                raise Refused("bundle", self.name + ": a row of synapses runs beyond its words; " + AGAIN)
            fields = bits[at + 10 : end].reshape(count, -1).astype(np.int64)
            powers = 1 << np.arange(index_bits + weight_bits, dtype=np.int64)
            dense = len(compartments) + np.arange(count)
            compartments += (fields[:, :index_bits] @ powers[:index_bits] if index_bits else dense).tolist()
            stored = fields[:, index_bits:] @ powers[:weight_bits]
            stored -= (stored >> weight_bits - 1) << weight_bits  # two's complement
            weights += (stored << REGISTER_BITS - weight_bits).tolist()
            at = -(-end // 64) * 64
        if len(weights) != synapses or at != 64 * (first + words):
            raise Refused("bundle", self.name + ": a row of synapses does not fill its words; " + AGAIN)
        return number, compartments, weights


def _value(bits: np.ndarray) -> int:
    return int(bits.astype(np.int64) @ (1 << np.arange(len(bits))))


class Network:
    """Everything about the network that the board and this program need."""

    def __init__(self, bundle: Bundle) -> None:
        self.bundle, claimed = bundle, str(bundle.manifest["sha256"])
        self.fingerprint = int(claimed[:8], 16) - (1 << 32 if int(claimed[0], 16) > 7 else 0)
        self.inputs, self.neurons = bundle.numbers("inputs", "neurons")
        self.steps, self.silent = bundle.numbers("steps", "silent_steps")
        self.regular, self.bias_input = (bool(number) for number in bundle.numbers("regular", "bias_input"))
        self.direct = bundle.direct  # neurons of places hear the cells of the front end: all stands in its folder
        try:
            self.host_spikes = int(bundle.manifest["limits"]["host_spikes"])
        except (KeyError, TypeError, ValueError):
            raise Refused("bundle", bundle.folder + ": its manifest has no limit of host spikes; " + AGAIN) from None
        self.adapted = False  # whether each query brings biases of its own
        self.ways: FrozenSet[str] = frozenset()  # names in board_ways.py
        self.ballast = 0  # bytes of a table that fills a chip's program up
        own = "front_end/" if self.direct else ""
        folders = sorted({name.rsplit("/", 1)[0] for name in bundle.files if name.startswith(own + "cores/")})
        self.cores = [Core(bundle, folder) for folder in folders]
        self.exc, self.counters = bundle.array(own + "host/exc.npy"), bundle.array(own + "host/counters.npy")
        if self.direct:  # the clock's first neuron, then pixels: what a query's biases are written to
            clock, pixels = bundle.array(own + "host/clock.npy"), bundle.array(own + "host/pixels.npy")
            self.injection, self.sources = np.zeros((0, 4), np.int32), np.concatenate([clock[:1], pixels])
            self.bias_input = True
        else:
            inputs = bundle.array("host/inputs.npy")
            self.injection = bundle.array("host/injection.npy")
            self.sources = inputs if self.bias_input else inputs[:0]  # nobody writes to relays
        chips = [self.exc[:, 0], self.sources[:, 0], self.injection[:, 1]]
        if self.direct:  # states are cleared everywhere
            chips.append(np.array([core.chip for core in self.cores]))
        self.chips = [int(chip) for chip in np.unique(np.concatenate(chips))]  # those that need a program of ours
        self.of = {(core.chip, core.core): core for core in self.cores}
        if self.host_spikes > ROOM:
            raise Refused("bundle", "the manifest allows more host spikes than a packet holds; " + AGAIN)
