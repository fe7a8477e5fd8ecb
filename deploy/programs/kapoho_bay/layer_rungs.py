"""The rungs of the layers of a spiking front end: a few neurons of a layer, driven by biases, in the layer's synapses.

A watcher spikes in every step until the neuron that it watches silences it: its count says when that one spiked.
This needs nothing but Python.
"""

from typing import Any, List, NamedTuple, Tuple

from rungs import SHIFT, decayed

SUMMING, LASTING, REPEATING = (4095, 0), (0, 0), (0, 4095)
"""Decays of u and v: a spike is a step of v; it is a current that lasts, which v sums up, or which v is."""
SILENCE = -127 << 7
"""What a neuron that spikes once takes from itself, in a row of its own: weights of it are 127 2^7."""
BEGIN, LATER, NEVER = 40, 100, 0
"""Biases of sources, whose thresholds are `AT_ONCE` and `SUMMED`: spikes in the first step, in the third, and none."""
AT_ONCE, SUMMED = 1, 200
ENDING = 4  # steps before the last one with input, in which watchers are silenced: nothing is on its way after it

Neuron = Tuple[int, int, int]  # decays of u and v, threshold
Synapse = Tuple[int, int, int]  # source, target, weight


class LayerRung(NamedTuple):
    """A rung: what it proves, what its failure means, and a network whose neurons are driven by biases alone.

    `biases` have a row for each presentation; they and thresholds are in units of a weight.
    """

    layer: str
    proves: str
    failure: str
    neurons: List[Neuron]
    synapses: List[Synapse]
    biases: List[List[int]]

    @property
    def name(self) -> str:
        """As the ladder has it."""
        return "front end: " + self.layer

    @property
    def presentations(self) -> int:
        """How many there are."""
        return len(self.biases)

    def counts(self, steps: int, silent: int) -> List[List[int]]:
        """Those of each presentation of so many steps, the silent ones included: biases stay."""
        return [self._presented(biases, steps + silent) for biases in self.biases]

    def built(self, networks: Any) -> Any:
        """Its network and what is sent to it, by what builds small networks of a board: neurons driven by biases."""
        return networks.of_biases(self)

    def _presented(self, biases: List[int], steps: int) -> List[int]:
        u, v, counts, arriving = ([0 for _ in self.neurons] for _ in range(4))
        for _ in range(steps):
            came, arriving = arriving, [0 for _ in self.neurons]
            for i, (decay_u, decay_v, threshold) in enumerate(self.neurons):
                u[i] = decayed(u[i], decay_u + 1) + (came[i] << SHIFT)
                v[i] = decayed(v[i], decay_v) + u[i] + (biases[i] << SHIFT)
                if v[i] > threshold << SHIFT:
                    v[i] = 0
                    counts[i] += 1
                    for source, target, weight in self.synapses:
                        arriving[target] += weight * (source == i)
        return counts


def layer_rungs(steps: int, heard: bool = False) -> List[LayerRung]:
    """A rung for each layer of the front end, for presentations with so many ``steps`` of input.

    Where neurons of places hear its cells (``heard``), they have a rung, too.
    """
    once, later, lasting = (*SUMMING, AT_ONCE), (*SUMMING, SUMMED), (*LASTING, 500)
    pixel, pair, pool, cell = (*SUMMING, 300), (*SUMMING, 1), (*SUMMING, 4), (*REPEATING, 8)
    place, root = (*REPEATING, 60), (*SUMMING, 3)
    sources, twice = [once, later, once], [[BEGIN, LATER, NEVER]] * 2
    taken = [(3, 3, -16), (4, 4, -16)]  # of two cells, from their own currents
    ended = [(6, 3, SILENCE), (6, 4, SILENCE)]  # of neurons of places, by the neuron that ends a rung

    def rung(
        layer: str,
        proves: str,
        failure: str,
        neurons: List[Neuron],
        synapses: List[Synapse],
        biases: List[List[int]],
        watched: Tuple[int, ...] = (),
    ) -> LayerRung:
        """With the synapses of neurons that spike once, watchers, and the neuron that ends these."""
        end = len(neurons)
        every = neurons + [(*SUMMING, max(1, steps - ENDING))] + [once for _ in watched]
        silenced = [(i, i, SILENCE) for i in range(end + 1) if every[i] not in (cell, place, root)]
        watching = [(source, w, SILENCE) for w, i in enumerate(watched, end + 1) for source in (i, end)]
        given = [row + [0] * (end - len(row)) + [1] + [BEGIN for _ in watched] for row in biases]
        return LayerRung(layer, proves, failure, every, synapses + silenced + watching, given)

    places = rung(
        "exc",
        "a current that lasts keeps a neuron spiking, inhibition that lasts ends it, and one synapse silences all",
        "membranes keep what dv takes, inhibition does not last, or neurons spike beyond the end of a query",
        [*sources, place, place, root],
        [(0, 3, 127), (1, 4, 100), (3, 5, 4), (4, 5, 4), (5, 4, -9), *ended],
        twice,
    )
    return [
        rung(
            "clock",
            "a bias makes a neuron spike, which silences itself and hands its spike on, a step each",
            "a bias counts otherwise, or rows with an exponent of their own are stored otherwise",
            [once] * 4,
            [(0, 1, 2), (1, 2, 2), (2, 3, 2)],
            [[BEGIN]] * 2,
            (0, 3),
        ),
        rung(
            "pixels",
            "the host writes biases before each query; a greater one makes a neuron spike earlier, a clock's spike too",
            "biases are not those that the host writes before each query, or are summed up otherwise",
            [once, pixel, pixel, pixel],
            [(0, 1, 100), (0, 2, 100), (0, 3, 100)],
            [[BEGIN, 120, 50, 1], [BEGIN, 1, 120, 50]],
            (1, 2, 3),
        ),
        rung(
            "filters",
            "a spike is a current that lasts, of either sign, and is gone before the next query",
            "a current does not last where decayU is 0, or outlives the query",
            [*sources, lasting, lasting, lasting],
            [(0, 3, 127), (0, 4, 127), (1, 4, -127), (1, 5, 127)],
            twice,
            (3, 4, 5),
        ),
        rung(
            "pairs",
            "a neuron spikes when both of two have spiked, whichever came first",
            "two spikes that come in different steps are not summed up",
            [*sources, pair, pair],
            [(0, 3, 1), (1, 3, 1), (0, 4, 1), (2, 4, 1)],
            twice,
            (3, 4),
        ),
        rung(
            "onsets",
            "a neuron spikes with the first of several, once",
            "a neuron does not silence itself for the rest of a query",
            [*sources, once, once, once],
            [(0, 3, 2), (1, 3, 2), (1, 4, 2), (2, 5, 2)],
            twice,
            (3, 4, 5),
        ),
        rung(
            "cells",
            "a neuron spikes in every step, as often as what it takes from its current lets it",
            "what a neuron takes from its own current is not felt in the next step, or that current does not last",
            [*sources, cell, cell],
            [(0, 3, 112), (1, 4, 48), *taken],
            twice,
        ),
        rung(
            "pools",
            "a neuron sums up the spikes of several, and silences these after so many",
            "spikes of several neurons are not summed up, or what silences these comes late",
            [*sources, cell, cell, pool],
            [(0, 3, 112), (0, 4, 112), *taken, (3, 5, 1), (4, 5, 1), (5, 3, -127), (5, 4, -127)],
            twice,
        ),
    ] + [places] * heard
