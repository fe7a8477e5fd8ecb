"""What is sent for a query."""

from typing import Optional

import numpy as np

from board_network import Network
from input_draws import biases, draw_spikes, phases, regular_spikes
from refusals import Refused

CLOCK, PIXEL = 1 | 7 << 12, 6 << 12  # bias of the clock's first neuron; exponent of pixels', whose mantissas are levels
LEVEL = 8000 << 6  # threshold of input compartments, in units of the membrane


class Query:
    """What is sent for one query, of inputs' ``rates``, or of pixels.

    Raises:
        Refused: more input spikes in a step than the host can send a chip.
    """

    def __init__(self, network: Network, number: int, rates: np.ndarray, key: int, given: Optional[tuple]) -> None:
        self.spikes, self.settings, self.biases, self.chips = {}, {}, {}, network.chips  # type: dict, dict, dict, list
        if given is not None:  # mantissas and exponents of all queries
            words = given[0][number] * 8 + given[1][number]
            self.biases = {chip: words[network.exc[:, 0] == chip] for chip in network.chips}
        if network.direct:
            words = np.zeros((len(network.sources), 2), np.int64)
            words[:, 0] = np.append(CLOCK, rates.reshape(-1).astype(np.int64) | PIXEL)
            self.settings = {chip: words[network.sources[:, 0] == chip] for chip in network.chips}
            return
        if network.bias_input:
            (mantissa, exponent), membrane = biases(rates, LEVEL), phases(key, network.inputs, LEVEL)
            words = np.stack([mantissa | exponent << 12, membrane], axis=1)
            self.settings = {chip: words[network.sources[:, 0] == chip] for chip in network.chips}
            return
        steps = network.steps
        drawn = regular_spikes(rates, key, steps, LEVEL) if network.regular else draw_spikes(rates, key, steps)
        for chip in network.chips:
            served = np.zeros(network.inputs, bool)
            served[network.injection[network.injection[:, 1] == chip, 0]] = True
            here = drawn & served
            most = int(here.sum(axis=1).max())
            if most > network.host_spikes:
                raise Refused(
                    "input",
                    f"query {number}: {most} inputs spike in one step, but the host sends a chip at most "
                    f"{network.host_spikes}; lower encoder.query_spikes or deploy with --input-mode bias",
                )
            self.spikes[chip] = here
