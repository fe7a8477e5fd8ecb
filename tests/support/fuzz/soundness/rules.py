"""What every accepted file satisfies, each rule with the name under which docs/security.md lists it.

Nothing in this folder imports the package: a file is read here by other means than the program's.

Used by project, storage and support.
"""

from __future__ import annotations

INVARIANTS = {
    "F1": "A container begins with the line of its kind and the SHA-256 of all that follows.",
    "F2": (
        "What follows is one zip archive with nothing before or behind it, whose names are a header and arrays, each "
        "once."
    ),
    "F3": (
        "The header is one JSON object without NaN or Infinity; every array is numeric and as long as its header says."
    ),
    "T1": "Every setting is one that there is, of its type; nothing is added and nothing read as something else.",
    "T2": "Every number is finite and within its range; every word is one of those allowed.",
    "T3": (
        "Settings that depend on each other fit: cells and image, network and learning, weights and their limit, views."
    ),
    "T4": "What the reader returns is what the file says, and for the rest the preset.",
    "M1": "The settings satisfy T1 to T4.",
    "M2": (
        "Weights are int16 (inputs, neurons), smaller than 2^bits, none below 0 without a sign; there are as many "
        "inputs as the settings make. Biases are int32 (neurons,) of 12 bits and one exponent; by none alone its "
        "neuron spikes."
    ),
    "M3": (
        "The network's numbers are whole and within the bits of the chip's registers; the steps of a presentation, "
        "with the silent ones that so many neurons need, bits, sign, trains and input mode are those of the settings."
    ),
    "M4": (
        "Neither a neuron's weights above 0, nor those below with the inhibition, sum to 2^17, so that the 24 bits of "
        "u cannot wrap."
    ),
    "M5": "Stretches follow each other without gap or overlap over all places, view after view, and all neurons; none "
    "is empty, and each has as many neurons as the settings make for its places, or at most those of its and of those "
    "that it says were removed. All views are cut alike, and there is a neuron.",
    "M6": "Place indices are int64, distinct, 0 to 2^53; the route has at least as many images as places.",
    "M7": "Labels are int64: 0 to places - 1 in order, once for every view of every traverse.",
    "M8": "Activity is float32 (images, inputs), finite and at least 0; pixels are at most 255.",
    "M9": "Responses are int32 (neurons, places), at least 0, and at most one spike a step of what was presented.",
    "M10": "Patches are uint8 (images, 28, 28), thumbnails uint8 (places, 48, 64, 3).",
    "M11": "Learned weights are float32 of the network's shape, finite and at least 0, or there are none (0, 0).",
    "M12": "There is one name a place, two at least: at most 1,024 characters, no NUL, Unicode. Figures are finite.",
    "M13": (
        "A conductance network is float64 weights and thresholds, finite and within their settings, and uint16 delays"
        " not above the longest."
    ),
    "M14": "What the reader returns equals what the file holds, number for number.",
    "M15": (
        "Positions, where there are any, are float64 (places, 2), finite, and within the range of their frame, which "
        "is xy, latlon, or a UTM zone."
    ),
    "C1": "The fingerprint is that of the training that goes on.",
    "C2": "Epochs done are whole numbers from 1 to the settings' epochs, of stretches that there are.",
    "C3": (
        "Of every stretch with epochs done all arrays are there, of the type and shape that its trainer has, and no "
        "others."
    ),
    "C4": (
        "Weights and thresholds are finite and within what learning can reach; delays and responses within what it "
        "made."
    ),
    "B1": "The manifest is of this format and version, for a board that there is, and has its own SHA-256.",
    "B2": "Every file of the manifest is a regular file below the folder, of the size and SHA-256 told.",
    "B3": (
        "The network's numbers satisfy M3 and M4, with as many silent steps; the references satisfy M1, M5 to M12, and "
        "M15."
    ),
    "B4": (
        "Rates uint16 (images, inputs), keys uint64 (images,), labels and responses on the host are those of the "
        "references."
    ),
    "B5": "Every register, bias, axon and word count is a whole number within its bits and within the core.",
    "B6": (
        "Rows tile a core's memory; every synapse is of a format that the core has and reaches a compartment that it "
        "has."
    ),
    "B7": (
        "Every neuron, inhibitory neuron, and bias or relay of an input stands on one compartment of its own; every "
        "axon leads to an axon that there is."
    ),
    "B8": "The weights and biases decoded from the board's files, bit by bit, are those that the reader returns.",
    "B9": (
        "The parameters of a Loihi 2 bundle are those of one place network, and say the same numbers everywhere; the "
        "steps of a presentation are a power of two."
    ),
    "B10": (
        "A network that learns has start weights uint8, thresholds in 1..2^17-1, and presentations that name an "
        "epoch, an image and a key that there are; its rule is within the engine's bits; the steps of a presentation "
        "are a power of two."
    ),
    "L1": (
        "A list yields one file for every line or row that names one, in its order; no name has a NUL, every file is "
        "regular."
    ),
    "L2": "All rows of a CSV list or of positions are equally wide; the column that is read is there once.",
    "L3": "A ground truth yields for each query exactly the places that the file names for it.",
    "L4": "Positions are one row or point a position, finite, in the file's numbers.",
}
"""The sentence of every rule."""


class Findings(list[str]):
    """Rules that a file breaks, each as its name and what is wrong."""

    def need(self, holds: object, rule: str, told: str) -> bool:
        """Note that ``rule`` is broken unless it ``holds``; whether it does."""
        if rule not in INVARIANTS:
            raise KeyError(f"{rule} is no rule")
        sound = bool(holds)
        if not sound:
            self.append(f"{rule}: {told}")
        return sound


def whole(value: object, low: int, high: int) -> bool:
    """Whether ``value`` is a whole number, no truth value, in ``low`` to ``high``."""
    return type(value) is int and low <= value <= high
