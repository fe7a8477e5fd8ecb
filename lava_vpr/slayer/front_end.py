"""The filters of the convolutional layer (`lava_vpr.inputs.orientation`), learned from references and nothing else.

In each epoch every reference is shown once, changed at random: shifted by pixels, its contrast, illumination and pixels
altered, and a share of the layer's spikes replaced by those of other references. Filters are rounded to 8 bits before
each step, and lava-dl's neuron makes the layer's spikes, those of deployment, with gradients. The loss is what a place
network of templates would confuse: the cross-entropy of the cosines, between an altered reference and every reference
as it is, each less the mean of all.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.engine.random import presentation_key
from lava_vpr.inputs import orientation as filters
from lava_vpr.inputs.encoder import EncoderConfig
from lava_vpr.slayer import needs
from lava_vpr.slayer.forward import STATE_UNIT as _UNIT, spiking

SIDE, EPOCHS, RATE, BATCH, SHARPNESS, WIDTH = 5, 4, 0.005, 50, 15.0, 1.0
"""Pixels of a filter's side; how often references are shown; Adam's rate, of weights up to 1; references of a step;
the factor on cosines; how far from the threshold, in thresholds, a neuron still learns."""
_PIXEL_NOISE = 0.02
"""Deviation of a pixel, in units of white, where ``augment.noise`` is 1."""


def oriented(channels: int, side: int = SIDE) -> NDArray[np.float64]:
    """Where learning starts: derivatives of a Gaussian in evenly spaced directions, (channels, side, side)."""
    half = side // 2
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    bell = np.exp(-(x * x + y * y) / (2 * (side / 5) ** 2))
    angles = np.pi * np.arange(channels) / channels
    made = np.array([(np.cos(a) * x + np.sin(a) * y) * bell for a in angles])
    return made / np.abs(made).max()


def rounded(weights: NDArray[np.floating[Any]]) -> NDArray[np.int8]:
    """``weights`` in units of which the largest is `lava_vpr.inputs.orientation.TOP`."""
    return np.rint(weights * (filters.TOP / np.abs(weights).max())).astype(np.int8)


def learned_filters(images: Iterable[NDArray[np.uint8]], config: Config, epochs: int = EPOCHS) -> str:
    """The setting ``encoder.filters`` that the references teach.

    Args:
        images: The references, each uint8 (h, w) or (h, w, 3) BGR; 2 at least.
        config: Settings, of which those of the encoder, ``augment`` and the seed count.
        epochs: How often each is shown; 0: the filters that learning starts from.
    Raises:
        ConfigError: lava-dl is missing.
    """
    needs.require()
    torch, encoder = needs.libraries().torch, config.encoder
    torch.set_num_threads(1)
    seen = np.array([filters.seen_by(one, encoder.image_size, encoder.blur) for one in images])
    start = oriented(encoder.orientations)
    weights = torch.nn.Parameter(torch.from_numpy(start[:, None].copy()))
    adam = torch.optim.Adam([weights], lr=RATE, foreach=False)
    for epoch in range(epochs):
        rng = np.random.default_rng(presentation_key(config.seed, "train", len(seen), epoch))
        shown = _changed(seen, config, rng)
        order = rng.permutation(len(seen))
        for first in range(0, len(order), BATCH):
            batch = order[first : first + BATCH]
            templates = layer(weights, seen, encoder)
            asked = layer(weights, shown[batch], encoder)
            replaced = torch.from_numpy(rng.random(tuple(asked.shape)) < config.augment.altered)
            others = torch.from_numpy(rng.integers(0, len(seen), tuple(asked.shape)))
            asked = torch.where(replaced, torch.gather(templates, 0, others), asked)
            mean = templates.mean(dim=0)
            cosines = _unit(asked - mean) @ _unit(templates - mean).T
            loss = torch.nn.functional.cross_entropy(cosines * SHARPNESS, torch.from_numpy(batch))
            adam.zero_grad()
            loss.backward()
            adam.step()
    return filters.written(rounded(weights.detach().numpy()[:, 0]))


def layer(weights: Any, seen: NDArray[np.float64], encoder: EncoderConfig) -> Any:
    """Spikes of the layer with gradients, a tensor (n, inputs); the numbers are those of `filters.spikes`.

    Args:
        weights: Filters before they are rounded, a tensor (channels, 1, side, side).
        seen: From `filters.seen_by`, (n, side, side).
        encoder: Settings.
    """
    torch, window = needs.libraries().torch, encoder.window
    pad, pool = torch.nn.functional.pad, torch.nn.functional.avg_pool2d
    scaled = weights * (filters.TOP / weights.detach().abs().max())
    whole = scaled + (torch.round(scaled) - scaled).detach()
    whole = whole[0].numel() * whole - whole.sum(dim=(2, 3), keepdim=True)  # `filters.balanced`
    images = pad(torch.from_numpy(seen)[:, None], (weights.shape[-1] // 2,) * 4, mode="reflect")
    large = torch.nn.functional.conv2d(images, whole).abs()
    total = large.sum(dim=1, keepdim=True)
    around = pool(pad(total, (window // 2,) * 4, mode="reflect"), window, stride=1)
    around = around + encoder.pool_floor * total.mean(dim=(2, 3), keepdim=True) + 1.0
    left = torch.relu(len(weights) * large - filters.RIVALRY * total) / around
    current = torch.nn.functional.max_pool2d(left, encoder.cell).flatten(1) * filters.UNIT
    current = (current + (torch.floor(current) - current).detach()).float() / _UNIT
    neuron = spiking(filters.THRESHOLD / _UNIT, 0.0, WIDTH)
    return neuron(current[:, :, None].expand(-1, -1, filters.STEPS)).sum(dim=-1)


def _unit(rows: Any) -> Any:
    """Every row with the Euclidean norm 1."""
    return rows / rows.norm(dim=1, keepdim=True).clamp_min(1e-9)


def _changed(seen: NDArray[np.float64], config: Config, rng: np.random.Generator) -> NDArray[np.float64]:
    """Every image once, changed at random; what lies beyond its edge repeats it."""
    changes, side, top = config.augment, seen.shape[1], 255.0 * filters.FINER
    most = changes.shift * config.encoder.cell
    across = np.linspace(-1.0, 1.0, side)
    made = []
    for image in seen:
        matrix = np.array([[1, 0, rng.uniform(-most, most)], [0, 1, 0]])
        moved = cv2.warpAffine(image, matrix, (side, side), borderMode=cv2.BORDER_REPLICATE) / top
        slope = rng.normal(0.0, changes.illumination, 2)
        moved *= np.exp(slope[0] * across[:, None] + slope[1] * across)
        moved **= np.exp(rng.normal(0.0, changes.contrast))
        moved += rng.normal(0.0, changes.noise * _PIXEL_NOISE, moved.shape)
        made.append(np.rint(np.clip(moved, 0.0, 1.0) * top))
    return np.array(made)
