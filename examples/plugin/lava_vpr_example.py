"""A kind of input, a learning rule, a neuron model and a decoder for lava-vpr, entry points of pyproject.toml."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.inputs.encoder import ChannelLayout, EncoderConfig, Input
from lava_vpr.matching.decoders import Decoder, Reading, in_every_variant, margin
from lava_vpr.matching.equations import Counts, Scores, ScoresOf
from lava_vpr.model import Stretch
from lava_vpr.neurons.models import NeuronConstants, NeuronModel, State, decayed
from lava_vpr.training.trainers import LearningRule, StretchTrainer

GRID = 28


def centre_surround(image: NDArray[np.uint8], encoder: EncoderConfig) -> NDArray[np.float32]:
    """How much brighter or darker each point of an image is than what surrounds it, as a retina's ON and OFF cells.

    Args:
        image: uint8 (h, w) or (h, w, 3) BGR.
        encoder: Settings; these channels need none.
    Returns:
        float32 (2 x 28 x 28,): ON, then OFF, each row by row, at least 0.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    small = cv2.resize(grey, (2 * GRID, 2 * GRID), interpolation=cv2.INTER_AREA).astype(np.float32)
    difference = cv2.GaussianBlur(small, (0, 0), 1.0) - cv2.GaussianBlur(small, (0, 0), 3.0)
    normal = difference / (cv2.GaussianBlur(np.abs(difference), (0, 0), 6.0) + 1.0)
    both = (np.maximum(normal, 0), np.maximum(-normal, 0))
    pooled = [cv2.resize(channel, (GRID, GRID), interpolation=cv2.INTER_AREA) for channel in both]
    return np.stack(pooled).astype(np.float32).reshape(-1)


def count_cosine(responses: Counts, reading: Reading) -> ScoresOf:
    """The cosine of the angle between a query's spike counts and those of each place's references.

    Args:
        responses: S^R, int (neurons, places).
        reading: How equations of the paper are read; this is none of them.
    Returns:
        The function from counts int (queries, neurons) to scores float64 (queries, places) in [0, 1].
    """
    templates = responses.astype(np.float64)
    templates /= np.maximum(np.linalg.norm(templates, axis=0), 1.0)

    def scores(counts: Counts) -> Scores:
        found = np.zeros((len(counts), templates.shape[1]))
        for score, row in zip(found, counts.astype(np.float64), strict=True):  # one by one: whatever others are asked
            score[:] = row @ templates / max(float(np.linalg.norm(row)), 1.0)
        return found

    return scores


class OjaTrainer(StretchTrainer):
    """Oja's rule (J. Math. Biol. 15, 1982), told the place: w += eta y (x - y w), y = w x, with rates x of length 1."""

    ETA = 0.2

    def __init__(self, config: Config, stretch: Stretch, key: int, activity: NDArray[np.float32]) -> None:
        inputs = config.encoder.inputs
        self.weights = np.full((inputs, stretch.neurons), inputs**-0.5, np.float32)

    def present(self, rates: NDArray[Any], key: int, place: int, epoch: int) -> NDArray[np.int32]:
        x, w = rates.astype(np.float64), self.weights[:, place].astype(np.float64)
        x /= max(float(np.linalg.norm(x)), 1.0)
        y = float(w @ x)
        self.weights[:, place] = w + self.ETA * y * (x - y * w)
        return np.zeros(self.weights.shape[1], np.int32)

    def state(self) -> dict[str, NDArray[Any]]:
        return {"weights": self.weights}

    def reach(self, epochs: int, traverses: int) -> dict[str, tuple[float, float]]:
        return {"weights": (0.0, 2.0)}


def adaptive(constants: NeuronConstants, state: State, drive: State) -> tuple[State, NDArray[np.bool_]]:
    """LIF whose threshold each spike raises by a quarter, which decays by 1/32 a step (Bellec et al., NeurIPS 2018)."""
    v, raised = decayed(state[0], constants.decay) + drive, decayed(state[1], 4096 // 32)
    spikes = v > constants.threshold + raised
    return np.stack([np.where(spikes, 0, v), raised + spikes * (constants.threshold >> 2)]), spikes


CENTRE_SURROUND = Input(
    "centre-surround",
    layout=lambda encoder: ChannelLayout(2, GRID),
    sees="image",
    activity=centre_surround,
    grey_levels=False,
    drawing="grey",
    legend="White: the neuron expects a point brighter than its surroundings; black: a darker one.",
)
OJA = LearningRule("oja", "by Oja's rule, one neuron a place", OjaTrainer, neuron_a_place=True)
ADAPTIVE = NeuronModel("adaptive", "LIF with a threshold that spikes raise", adaptive, states=2)
COUNT_COSINE = Decoder(
    "count-cosine",
    title="cosine of the counts",
    confidence=margin,
    scores=in_every_variant(count_cosine),
)
