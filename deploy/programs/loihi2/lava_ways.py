"""Other ways to ask Lava and lava-loihi; see docs/own_board.md."""

from __future__ import annotations

from ladder import REFERENCES
from ways import OtherWay

FIRST = ("one neuron", "one axon")
INJECTED = OtherWay("injected", "inputs", "spikes of inputs are made here and injected, not by biases", FIRST)
WAYS = [
    OtherWay("scalars", "values", "neurons are made with one value for all, and set before the first query", FIRST),
    OtherWay("fresh", "runs", "every query is a run of its own, from a new network", ("reset",)),
    OtherWay("any-lava", "lava", "a lava-nc other than 0.10 is taken", ()),
]
OF_PIXELS = [
    WAYS[0]._replace(cures=REFERENCES[:1]),
    WAYS[1]._replace(cures=()),
    WAYS[2],
]
"""Of bundles that take pixels, of which there are only pictures to try: to compile the network for each takes long."""
