"""Learned receptive fields, drawn so that a person can read them: edge strokes beside the place's image."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

CELL = 100
"""Side of one grid cell in the drawing's own units; integers keep the file small."""

_OPACITIES = (0.22, 0.4, 0.7, 1.0)
# A stroke weaker than this share of the neuron's strong weights would only be dust.
_WEAKEST = 0.15


def edge_direction(channel: int, orientations: int) -> tuple[float, float]:
    """Unit vector (x, y), y down, along the visible edge that excites orientation ``channel``.

    The channel is named by its gradient's angle, channel 180 / orientations degrees; the edge is perpendicular to it.
    """
    angle = math.pi * channel / orientations
    return -math.sin(angle), math.cos(angle)


def strokes(weights: NDArray[Any], orientations: int, grid: int) -> str:
    """One neuron's orientation weights as SVG: in every cell a stroke per channel along the edge it expects.

    Args:
        weights: Shape (orientations * grid * grid,), at least 0, ordered channel, row, column.
    Returns:
        An ``<svg>`` that fills whatever box it is put in; stroke length and opacity grow with the weight.
    """
    maps = weights.astype(np.float64).reshape(orientations, grid, grid)
    # The largest weight may be a lone outlier; a high percentile of the non-zero ones keeps the rest visible.
    strong = float(np.percentile(maps[maps > 0], 98)) if np.any(maps > 0) else 1.0
    relative = np.clip(maps / strong, 0, 1)
    paths: list[list[str]] = [[] for _ in _OPACITIES]
    for channel, row, column in np.argwhere(relative >= _WEAKEST):
        weight = float(relative[channel, row, column])
        dx, dy = edge_direction(int(channel), orientations)
        half = 0.56 * CELL * weight
        x = round((column + 0.5) * CELL - half * dx)
        y = round((row + 0.5) * CELL - half * dy)
        bucket = min(int(weight * len(_OPACITIES)), len(_OPACITIES) - 1)
        paths[bucket].append(f"M{x} {y}l{round(2 * half * dx)} {round(2 * half * dy)}")
    side = grid * CELL
    body = "".join(f'<path opacity="{o}" d="{"".join(p)}"/>' for o, p in zip(_OPACITIES, paths, strict=True) if p)
    return (
        f'<svg class="strokes" viewBox="0 0 {side} {side}" preserveAspectRatio="none" aria-hidden="true">{body}</svg>'
    )


def representatives(neuron_places: NDArray[np.integer[Any]], limit: int) -> NDArray[np.intp]:
    """At most ``limit`` neurons of different places, evenly spread over the route, in route order."""
    places, neurons = np.unique(neuron_places, return_index=True)
    neurons = neurons[places >= 0]
    if len(neurons) <= limit:
        return neurons.astype(np.intp)
    return neurons[np.linspace(0, len(neurons) - 1, limit).round().astype(np.intp)]
