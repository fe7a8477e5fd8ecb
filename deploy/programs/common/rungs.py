"""The rungs of the ladder of self-tests: small networks, each of which shows one thing, and the counts they must give.

A network has inputs that spike in every step, or never, and one inhibitory neuron, as that of the bundle. Its counts
are worked out here in whole numbers, step by step, from nothing but the rung. This needs nothing but Python.
"""

from typing import Any, List, NamedTuple

SHIFT, DECAY_BITS = 6, 12


class Rung(NamedTuple):
    """One rung: what it proves, what its failure means, and its network.

    Weights are lists of a row for each input; `active` says which inputs spike. The threshold and what the inhibitory
    neuron takes (`lateral`) are in units of a weight, the decay in units of 2^-12.
    """

    name: str
    proves: str
    failure: str
    weights: List[List[int]]
    active: List[bool]
    threshold: int
    decay: int
    lateral: int
    presentations: int

    def built(self, networks: Any) -> Any:
        """Its network and what is sent to it, by what builds small networks of a board: inputs injected."""
        return networks.of_inputs(self)

    def counts(self, steps: int, silent: int) -> List[List[int]]:
        """Those of each presentation of ``steps`` steps with input, which the next step feels, and silent ones."""
        return [expected(self, steps, silent)] * self.presentations


def rungs(bits: int, signed: bool, lateral: int, steps: int) -> List[Rung]:
    """All rungs for weights of so many ``bits`` besides a sign, and presentations with so many ``steps`` of input."""
    top = (1 << bits) - 1
    powers = [1 << bit for bit in range(bits)] + [top]
    found = [
        Rung(
            "one neuron",
            "an injected spike reaches a synapse, a membrane sums up, a neuron spikes and is counted",
            "nothing else can work: see to the board, to how spikes are injected, or to how counters are read",
            *([[top]], [True], 3 * top - 1, 0, 0, 1),
        ),
        Rung(
            "one axon",
            "an input reaches its own neuron and no other",
            "axons lead elsewhere than registers say: synapseMap, or the axon that is injected into",
            *([[top, 0], [0, top]], [False, True], 3 * top - 1, 0, 0, 1),
        ),
        Rung(
            "weights",
            "every bit of a weight has its value",
            "weights are read with other bits: wgtBits, wgtExp, or the alignment of a weight in its register",
            *([powers], [True], 4 * top - 1, 0, 0, 1),
        ),
    ]
    if signed:
        minus = [-power for power in powers]
        found.append(
            Rung(
                "signs",
                "a weight below 0 takes off what it says",
                "the sign of a weight is lost or elsewhere: fanoutType (mixed signs)",
                *([[top] * len(minus), [top] * len(minus), minus], [True] * 3, 4 * top - 1, 0, 0, 1),
            )
        )
    found += [
        Rung(
            "decay",
            "a membrane loses its share in every step, rounded towards 0",
            "decayV is another than the bundle's, or the chip rounds otherwise",
            *([[top, (top + 1) // 2]], [True], 2 * top, 700, 0, 1),
        ),
        Rung(
            "threshold",
            "a membrane at the threshold does not spike, one above it does",
            "the threshold is compared otherwise, or is not in units of 64",
            *([[top, (top + 1) // 2]], [True], 2 * top, 0, 0, 1),
        ),
        Rung(
            "reset",
            "membranes and counts are 0 at the beginning of every presentation",
            "states outlive a query: queries would mix",
            *([[1, top], [0, top]], [True, True], steps, 0, 0, 3),
        ),
    ]
    if lateral:
        found.append(
            Rung(
                "inhibition",
                "the inhibitory neuron inhibits every neuron, two steps after any has spiked",
                "the inhibitory neuron does not listen, takes another amount, or at another step",
                *([[top, 1]] * 4, [True] * 4, 3 * top, 200, lateral, 2),
            )
        )
    return found


def decayed(value: int, decay: int) -> int:
    """What a decay leaves of a value, rounded towards 0."""
    kept = abs(value) * ((1 << DECAY_BITS) - decay) >> DECAY_BITS
    return kept if value >= 0 else -kept


def expected(rung: Rung, steps: int, silent: int) -> List[int]:
    """The counts of one presentation of ``steps`` steps with input, which the next step feels, and silent ones."""
    neurons = range(len(rung.weights[0]))
    spiking = [row for row, active in zip(rung.weights, rung.active) if active]  # noqa: B905 (3.6 lacks strict)
    drive = [sum(row[i] for row in spiking) for i in neurons]
    v, counts, fired, pulled = [0 for _ in neurons], [0 for _ in neurons], False, False
    for step in range(steps + silent):
        listened, taken, fired = fired, pulled, False
        for i in neurons:
            arrived = (drive[i] if 0 < step <= steps else 0) - (rung.lateral if taken else 0)
            v[i] = decayed(v[i], rung.decay) + (arrived << SHIFT)
            if v[i] > rung.threshold << SHIFT:
                v[i], fired = 0, True
                counts[i] += 1
        pulled = listened
    return counts
