"""VPRTempo, a peer of this project, written from its equations.

Hines, Stratton, Milford, Fischer, "VPRTempo: A Fast Temporally Encoded Spiking Neural Network for Visual Place
Recognition", ICRA 2024 (arXiv 2309.10225). Equation and table numbers are the paper's as others quote them: its full
text was not at hand, and the rules were read off the released code as well. One spike of each neuron stands for when
it fires in a cycle: a brighter pixel fires earlier and counts more, so a spike is a number, 0..0.9 (pixels: 0..1), and
a layer is a matrix product. A feature layer learns by spike timing without labels, then an output layer with one neuron
a place is forced to spike for its own place.

Where the paper and its code (QVPR/VPRTempo 1.1.11) differ, the code is followed: no constant input (the paper: C =
0.1), all features reach all outputs, and queries pass the two matrices without thresholds. In one thing the paper is
followed: the code leaves the spikes out of the thresholds' rule (eq. 5), so that all thresholds fall to 0.
`benchmarks.peers.vprtempo_recall` compares recall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError

Floats = NDArray[np.float32]

SIDE, WINDOW = 56, 15
"""VPRTempo's own images: pixels a side, and the window of their patch normalisation (defaults of the released code)."""
SMALL_SIDE, SMALL_WINDOW = 28, 7
"""Pixels a side, and the window, of VPRSNN's images and the paper's."""


@dataclass(frozen=True)
class VprTempoConfig:
    """Settings; defaults from the paper's Table I where it has them, else from the released code.

    Attributes:
        features_per_input: Feature neurons for each pixel.
        excitatory, inhibitory: Probability of a connection of either kind, pixel to feature (P_exc, P_inh).
        output_excitatory, output_inhibitory: Probability of a connection of either kind, feature to output.
        threshold: Thresholds of features start in U[0, threshold] (theta_max).
        lowest_rate, highest_rate: Target rates of features rise evenly between these (f_min, f_max).
        constant: Features get U[0, constant] as input besides (C; the paper: 0.1).
        learning_rate: eta_STDP at the start.
        threshold_rate: eta_ITP at the start.
        balance: The rate at which inhibition is balanced, this many times eta_STDP (eq. 4).
        forced: Amplitude that is wanted of the right output, and that features settle at.
        ceiling: Largest spike.
        epochs: How often each image is shown to each layer.
        anneal_every: Steps between adjustments of the rates (eq. 3).
    """

    features_per_input: int = 2
    excitatory: float = 0.1
    inhibitory: float = 0.5
    output_excitatory: float = 1.0
    output_inhibitory: float = 1.0
    threshold: float = 0.5
    lowest_rate: float = 0.2
    highest_rate: float = 0.9
    constant: float = 0.0
    learning_rate: float = 0.005
    threshold_rate: float = 0.15
    balance: float = 50.0
    forced: float = 0.5
    ceiling: float = 0.9
    epochs: int = 4
    anneal_every: int = 100


WEAKEST, STRONGEST = np.float32(1e-6), np.float32(10.0)
"""A connection keeps its sign and a magnitude between these (released code)."""


@dataclass(frozen=True)
class Layer:
    """Weights and what else decides a layer's spikes.

    Attributes:
        weights: float32 (neurons, inputs); 0 where there is no connection, negative where it inhibits.
        threshold: float32 (neurons,).
        constant: Constant input, float32 (neurons,).
        rate: Target rates, float32 (neurons,); empty: none, and thresholds stay.
    """

    weights: Floats = field(repr=False)
    threshold: Floats = field(repr=False)
    constant: Floats = field(repr=False)
    rate: Floats = field(repr=False)


@dataclass(frozen=True)
class VprTempo:
    """A trained network of VPRTempo, layer by layer.

    Attributes:
        feature, output: The layer of features, and the layer with one neuron a place.
    """

    feature: Layer
    output: Layer

    @property
    def nbytes(self) -> int:
        """The bytes that answering queries needs: both matrices."""
        return self.feature.weights.nbytes + self.output.weights.nbytes

    def scores(self, spikes: Floats) -> Floats:
        """Amplitudes of the output neurons for input ``spikes`` (n, inputs): float32 (n, places), higher is better.

        Raises:
            InputError: ``spikes`` are not as many as the network has inputs.
        """
        if spikes.ndim != 2 or spikes.shape[1] != self.feature.weights.shape[1]:
            raise InputError(
                f"vprtempo: queries of shape {spikes.shape}, the network has {self.feature.weights.shape[1]} inputs; "
                "preprocess queries and references alike"
            )
        return np.asarray(spikes @ self.feature.weights.T @ self.output.weights.T)


def preprocess(image: NDArray[np.uint8], side: int = SIDE, window: int = WINDOW) -> NDArray[np.uint8]:
    """VPRTempo's own input: gamma-corrected, resized and patch-normalised, uint8 (side, side).

    Grey levels p become p^gamma with gamma = ln(0.5 x 255) / ln(mean p) (eq. 8); then bilinear resize, and z-scores in
    windows cut off at the border (standard deviation of a sample), clipped to -1..1, as 255 (1 + z) / 2, truncated.

    Args:
        image: uint8 (h, w), or (h, w, 3) BGR.
        side: Pixels of the result.
        window: Odd; pixels a side.
    Raises:
        InputError: an image without pixels, or a window that fits no centre.
    """
    if image.size == 0 or side < 1 or window < 3 or window % 2 == 0:
        raise InputError(
            f"vprtempo: image {image.shape}, side {side}, window {window}; the window must be odd, from 3 on"
        )
    grey = image.astype(np.float32)
    if image.ndim == 3:
        grey = grey @ np.array([0.114, 0.587, 0.299], np.float32)  # blue, green, red
    mean = float(grey.mean())
    if mean > 1:  # darker images have no such exponent
        grey = np.clip(grey ** np.float32(math.log(0.5 * 255) / math.log(mean)), 0, 255)
    small = cv2.resize(grey, (side, side), interpolation=cv2.INTER_LINEAR).astype(np.float64)
    inside = np.ones_like(small)
    box = (window, window)
    count, total, squares = (
        cv2.boxFilter(values, -1, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
        for values in (inside, small, small * small)
    )
    spread = np.sqrt(np.maximum(0.0, (squares - total * total / count) / (count - 1)))
    # Sums of squares near 1e6 leave rounding errors near 1e-5 in the spread of a window without contrast.
    z = np.divide(small - total / count, spread, out=np.zeros_like(small), where=spread > 1e-3)
    return (255.0 * (1.0 + np.clip(z, -1.0, 1.0)) / 2.0).astype(np.uint8)


def input_spikes(images: NDArray[np.uint8]) -> Floats:
    """Spikes of preprocessed images: pixel / 255, float32 (n, pixels).

    Raises:
        InputError: no uint8 images.
    """
    if images.ndim != 3 or images.dtype != np.uint8 or images.size == 0:
        raise InputError(f"vprtempo: images {images.dtype} of shape {images.shape}, must be uint8 (images, h, w)")
    return images.reshape(len(images), -1).astype(np.float32) / np.float32(255.0)


def _half(neurons: int, inputs: int, probability: float, rng: np.random.Generator) -> Floats:
    """Magnitudes of one sign, float32 (neurons, inputs): N(1/2, 1/6), not negative, sum 1 for each neuron."""
    weights = np.maximum(0.5 + rng.standard_normal((neurons, inputs), np.float32) / 6, 0)
    weights[rng.random((neurons, inputs), np.float32) >= probability] = 0
    total = weights.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(weights, total, out=weights, where=total > 0))


def new_layer(neurons: int, inputs: int, excitatory: float, inhibitory: float, rng: np.random.Generator) -> Layer:
    """An untrained layer with thresholds 0; a pair that is connected both ways keeps the difference and its sign."""
    weights = _half(neurons, inputs, excitatory, rng) - _half(neurons, inputs, inhibitory, rng)
    zeros = np.zeros(neurons, np.float32)
    return Layer(weights, zeros, zeros.copy(), np.zeros(0, np.float32))


@nb.njit(cache=True, nogil=True)
def _learn(
    weights: Floats, total: Floats, pre: Floats, change: Floats, eta: float, balance: float, low: float, high: float
) -> None:
    """Add ``change[j] pre[i]`` to the magnitude or value of every connection, keep signs, and balance inhibition.

    Args:
        weights: float32 (neurons, inputs), changed.
        total: Net input before thresholds, float32 (neurons,).
        pre: float32 (inputs,): what each input contributes.
        change: float32 (2, neurons): for excitatory and for inhibitory weights.
        eta, balance: Inhibitory weights are multiplied by 1 + balance eta total (eq. 4).
        low, high: Smallest and largest magnitude.
    """
    low32, high32 = np.float32(low), np.float32(high)
    for j in range(weights.shape[0]):
        up, down = change[0, j], change[1, j]
        factor = np.float32(1.0 + balance * eta * total[j])
        for i in range(weights.shape[1]):
            w = weights[j, i]
            if w > 0:
                w = min(high32, max(low32, np.float32(w + up * pre[i])))
            elif w < 0:
                w = max(-high32, min(-low32, np.float32(w + down * pre[i])))
                w = max(-high32, min(-low32, np.float32(w * factor)))
            weights[j, i] = w


def _annealed(t: int, steps: int, every: int) -> float:
    """Share of the initial rates in step ``t`` of ``steps``: ((steps - t') / steps)^2 (eq. 3), t' the last adjustment.

    The released code adjusts after step 0, every, 2 every ..; so the share of step t is that of the steps before it.
    """
    last = (t - 1) // every * every if t > 0 else 0
    return (1.0 - last / steps) ** 2


def feature_step(layer: Layer, spikes: Floats, share: float, config: VprTempoConfig) -> None:
    """One image to the feature layer, which changes: STDP, balance of inhibition, thresholds (eq. 1, 2, 4, 5).

    Args:
        layer: The feature layer.
        spikes: Spikes of the image, float32 (inputs,).
        share: Share of the initial learning rates.
        config: Settings.
    """
    total = layer.weights @ spikes + layer.constant
    post = np.clip(total - layer.threshold, 0.0, np.float32(config.ceiling))
    eta = config.learning_rate * share
    towards = np.where(post > 0, np.float32(eta) * (np.float32(config.forced) - post), np.float32(0))
    # Inhibition is strengthened where excitation is: the magnitude grows, the weight falls.
    change = np.stack([towards, -towards])
    _learn(layer.weights, total, (spikes > 0).astype(np.float32), change, eta, config.balance, WEAKEST, STRONGEST)
    rate = np.float32(config.threshold_rate * share)
    np.maximum(layer.threshold + rate * (post - layer.rate), 0, out=layer.threshold)


def output_step(layer: Layer, features: Floats, rate: Floats, place: int, share: float, config: VprTempoConfig) -> None:
    """One image to the output layer, which changes: the neuron of ``place`` is wanted to spike, others not (eq. 6, 4).

    Args:
        layer: The output layer.
        features: Spikes of the feature layer, float32 (features,).
        rate: Target rates of the features (features,); rare ones learn faster.
        place: Index of the output neuron that stands for the image's place.
        share: Share of the initial learning rates.
        config: Settings.
    """
    total = layer.weights @ features
    missing = -np.clip(total, 0.0, np.float32(config.ceiling))
    missing[place] += np.float32(config.forced)
    eta = config.learning_rate * share
    change = np.float32(eta) * np.stack([missing, missing])
    _learn(layer.weights, total, features / rate, change, eta, config.balance, WEAKEST, STRONGEST)


def _checked(spikes: Floats, labels: NDArray[np.int64] | None) -> NDArray[np.int64]:
    """The place of each image, int64 (n,).

    Raises:
        InputError: spikes or labels that cannot be learned.
    """
    if spikes.ndim != 2 or spikes.size == 0 or not np.isfinite(spikes).all() or spikes.min() < 0 or spikes.max() > 1:
        raise InputError(f"vprtempo: references of shape {spikes.shape}, must be (images, pixels) in 0..1")
    places = np.arange(len(spikes)) if labels is None else np.asarray(labels)
    if places.shape != (len(spikes),) or sorted(set(places.tolist())) != list(range(int(places.max()) + 1)):
        raise InputError(
            f"vprtempo: labels of shape {places.shape} must number the places of {len(spikes)} images from 0"
        )
    return places


def train(
    spikes: Floats, labels: NDArray[np.int64] | None = None, config: VprTempoConfig | None = None, seed: int = 0
) -> VprTempo:
    """Learn the references, layer after layer; every epoch in an order of its own.

    Args:
        spikes: Spikes of the reference images, float32 (images, pixels), 0..1.
        labels: Place of each image, 0 .. places - 1; None: each is its own place.
        config: Settings; None: the defaults.
        seed: The seed of weights, thresholds and order.
    Raises:
        InputError: no spikes, or labels that do not number the places.
    """
    settings, places = config or VprTempoConfig(), _checked(spikes, labels)
    spikes = np.ascontiguousarray(spikes, np.float32)
    rng = np.random.default_rng(seed)
    inputs, steps = spikes.shape[1], settings.epochs * len(spikes)
    neurons = settings.features_per_input * inputs
    start = new_layer(neurons, inputs, settings.excitatory, settings.inhibitory, rng)
    feature = Layer(
        start.weights,
        rng.uniform(0, settings.threshold, neurons).astype(np.float32),
        rng.uniform(0, settings.constant, neurons).astype(np.float32),
        np.linspace(settings.lowest_rate, settings.highest_rate, neurons + 1, dtype=np.float32)[1:],
    )
    for t, image in enumerate(_order(len(spikes), settings.epochs, rng)):
        feature_step(feature, spikes[image], _annealed(t, steps, settings.anneal_every), settings)
    sums = spikes @ feature.weights.T + feature.constant
    features = np.clip(sums - feature.threshold, 0.0, np.float32(settings.ceiling))
    output = new_layer(int(places.max()) + 1, neurons, settings.output_excitatory, settings.output_inhibitory, rng)
    for t, image in enumerate(_order(len(spikes), settings.epochs, rng)):
        annealed = _annealed(t, steps, settings.anneal_every)
        output_step(output, features[image], feature.rate, int(places[image]), annealed, settings)
    return VprTempo(feature, output)


def _order(images: int, epochs: int, rng: np.random.Generator) -> list[int]:
    """Which image is shown in each step."""
    return [int(image) for _ in range(epochs) for image in rng.permutation(images)]
