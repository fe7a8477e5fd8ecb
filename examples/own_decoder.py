"""A decoder of your own beside those that are there, on the same spikes.

    python examples/own_decoder.py summer/ winter/

A decoder sees the reference responses, spikes of each neuron for each place, and a query's spike counts, and gives
every place a score. This one lets each neuron vote for one place, as loud as it spikes. Image i of both folders shows
place i. `examples/plugin` brings a decoder to every command, as a package.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from lava_vpr import LavaVprError, train
from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.encoding import encode_traverse
from lava_vpr.matching.decoders import DECODERS, Decoder, Reading, in_every_variant, margin, prepare
from lava_vpr.matching.equations import Counts, Scores, ScoresOf
from lava_vpr.traverse import open_traverse


def votes(responses: Counts, reading: Reading) -> ScoresOf:
    """Every neuron's spikes count for the place that it spiked most for.

    Args:
        responses: Spikes of each neuron for each place, int (neurons, places).
        reading: How equations of the paper are read; this is none of them.
    Returns:
        The function from counts int (queries, neurons) to scores float64 (queries, places).
    """
    place_of = np.eye(responses.shape[1])[responses.argmax(axis=1)]

    def scores(counts: Counts) -> Scores:
        return counts.astype(np.float64) @ place_of  # whole numbers: the same in every order

    return scores


def main() -> None:
    """Compare the decoders."""
    parser = argparse.ArgumentParser(description="Compare a decoder of your own with those that are there.")
    parser.add_argument("reference", help="the drive to learn: a folder, list, video or ROS bag")
    parser.add_argument("query", help="the same places again")
    said = parser.parse_args()
    DECODERS.register(Decoder("votes", title="votes", confidence=margin, scores=in_every_variant(votes)))
    try:
        model = train(said.reference)
        queries = encode_traverse(open_traverse(said.query), model.config.encoder)
        if len(queries) != model.places:
            sys.exit(f"error: {said.query}: has {len(queries)} images, {said.reference} {model.places}; give as many")
        counts, _ = HostBackend().count_spikes(model, query_presentations(model, queries))
        for name in DECODERS:
            found = prepare(name, model.responses)(counts).argmax(axis=1)
            print(f"{name:22} {np.mean(found == np.arange(model.places)):.1%} right")
    except LavaVprError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
