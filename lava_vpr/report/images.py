"""Images as data URIs: thumbnails, contact sheets, grey-level maps; learned receptive fields as strokes along edges."""

from __future__ import annotations

import base64
import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

# Below this many pixels PNG costs little and keeps every pixel of what the network sees.
_LOSSLESS_PIXELS = 4096
_JPEG_QUALITY = 88


def data_uri(image: NDArray[np.uint8], lossless: bool = False) -> str:
    """``image`` (h, w) or (h, w, 3) BGR as a ``data:`` URI, a PNG if it is small or ``lossless``, else a JPEG."""
    small = lossless or image.shape[0] * image.shape[1] <= _LOSSLESS_PIXELS
    if small:
        data = as_png(image)
    else:
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()
    return f"data:image/{'png' if small else 'jpeg'};base64,{base64.b64encode(data).decode('ascii')}"


def shrunk(image: NDArray[np.uint8], longest: int) -> NDArray[np.uint8]:
    """``image``, averaged down if a side is longer than ``longest`` pixels."""
    height, width = image.shape[:2]
    factor = longest / max(height, width)
    if factor >= 1:
        return image
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


class ContactSheet(NamedTuple):
    """Images side by side in one JPEG, row by row.

    Attributes:
        uri: Its ``data:`` URI.
        columns, rows: Images in a row, and in a column.
        shape: Height and width of each image before it was reduced, in pixels.
    """

    uri: str
    columns: int
    rows: int
    shape: tuple[int, int]

    def style(self, selector: str) -> str:
        """The style of elements that show one image of the sheet, each by its ``background-position``."""
        height, width = self.shape
        return (
            f"{selector}{{background-image:url({self.uri});background-size:{100 * self.columns}% {100 * self.rows}%;"
            f"aspect-ratio:{width}/{height}}}"
        )


def as_png(image: NDArray[np.uint8]) -> bytes:
    """``image`` (h, w) or (h, w, 3) BGR as a PNG file."""
    return bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes())


_PIXELS, _CHARACTERS = 2_000_000, 500_000


def contact_sheet(images: NDArray[np.uint8]) -> ContactSheet:
    """All ``images`` (n, h, w, 3) in one JPEG of at most about `_PIXELS` pixels and `_CHARACTERS` characters."""
    count, height, width = images.shape[:3]
    columns = max(1, math.ceil(math.sqrt(count * height / width)))
    rows = max(1, math.ceil(count / columns))
    factor = min(1.0, math.sqrt(_PIXELS / max(1, count * height * width)))
    while True:
        tile = (max(1, int(width * factor)), max(1, int(height * factor)))
        sheet = np.zeros((rows * tile[1], columns * tile[0], 3), dtype=np.uint8)
        for i, image in enumerate(images):
            y, x = (i // columns) * tile[1], (i % columns) * tile[0]
            small = image if factor == 1 else cv2.resize(image, tile, interpolation=cv2.INTER_AREA)
            sheet[y : y + tile[1], x : x + tile[0]] = small
        uri = data_uri(sheet)
        if len(uri) <= _CHARACTERS or tile == (1, 1):
            return ContactSheet(uri, columns, rows, (height, width))
        factor *= 0.95 * math.sqrt(_CHARACTERS / len(uri))


def weight_image(weights: NDArray[Any], grid: int, points: int = 0) -> NDArray[np.uint8]:
    """One neuron's weights of one channel (grid^2,) or two (2 grid^2,) as grey levels, (grid, grid).

    With one channel, 0 is black and the largest weight white. With two, a weight of the first channel alone is white,
    of the second alone black, and equal weights are grey. Channels of fewer ``points`` than the grid has cells fill it
    from its start; the other cells have no weight.
    """
    maps = np.zeros((len(weights) // (points or grid**2), grid**2))
    maps[:, : points or grid**2] = weights.reshape(len(maps), -1)
    maps = maps.reshape(-1, grid, grid)
    top = max(float(np.abs(maps).max()), 1e-12)
    level = maps[0] / top if len(maps) == 1 else 0.5 + 0.5 * (maps[0] - maps[1]) / top
    return np.clip(np.round(255 * level), 0, 255).astype(np.uint8)


CELL = 100
"""Side of a grid cell in units of the drawing, whose integers keep the file small."""

_OPACITIES = (0.22, 0.4, 0.7, 1.0)
# Strokes weaker than this share of the neuron's strong weights are left out: they would be specks.
_WEAKEST = 0.15


def edge_direction(channel: int, orientations: int) -> tuple[float, float]:
    """Unit vector (x, y), y down, along the visible edge that excites orientation ``channel``.

    The channel is named by its gradient's angle, channel 180 / orientations degrees; the edge is perpendicular to it.
    """
    angle = math.pi * channel / orientations
    return -math.sin(angle), math.cos(angle)


def strokes(weights: NDArray[Any], orientations: int, grid: int) -> str:
    """One neuron's orientation weights as SVG: in each cell a stroke for each channel, along the edge that excites it.

    Args:
        weights: Shape (orientations * grid * grid,), at least 0, ordered channel, row, column.
    Returns:
        An ``<svg>`` element that fills its container; stroke length and opacity grow with the weight.
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
    """Indices of at most ``limit`` neurons of different places, evenly spread over the route, in its order."""
    places, neurons = np.unique(neuron_places, return_index=True)
    neurons = neurons[places >= 0]
    if len(neurons) <= limit:
        return neurons.astype(np.intp)
    return neurons[np.linspace(0, len(neurons) - 1, limit).round().astype(np.intp)]
