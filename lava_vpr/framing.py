"""What is encoded of an image: all of it, or what stands between the bars at its edges (``--crop auto``).

Bars are cropped where an image was squeezed between them, and masked where they cover a part of it: then what is seen
stays where it is, and inputs under a bar are silent. Pixels do not tell which it is. Queries are compared with the
references in each way, and the way that fits better, by the cosine of the inputs that are not silent, is taken.
References have nothing to be compared with: equal bars on opposite edges are taken for those of a squeezed image,
others for painted ones.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lava_vpr.encoding import Framed, Framing, activity_of
from lava_vpr.errors import ConfigError, shown
from lava_vpr.images.borders import Border, border_of, common_border
from lava_vpr.inputs.encoder import INPUTS, EncoderConfig
from lava_vpr.traverse import Traverse

CROPS = NO_CROP, AUTO = "none", "auto"
"""What ``--crop`` can be."""
RECENT, HELD = 9, 30
"""Images whose median says where bars end, so that no single one moves them; and those with bars that are compared
with references, until how these bars are left out is settled."""
SAMPLED, ALIKE = 32, 0.02
"""Most references that are looked at for bars; and by how much of a side equal bars may differ."""


def check_crop(crop: str, encoder: EncoderConfig) -> None:
    """Refuse to crop what has no edges.

    Raises:
        ConfigError: the inputs see no images, or have no places in them.
    """
    if crop != NO_CROP and (INPUTS[encoder.kind].sees == "vector" or encoder.layout.points):
        raise ConfigError(f"--crop {crop} is for images, but inputs {encoder.kind!r} have no edges; leave it out")


def of_references(
    traverse: Traverse, encoder: EncoderConfig, crop: str, tell: Callable[[str], object] = lambda line: None
) -> Framing | None:
    """The part of the references to encode if they have bars in common, which ``tell`` reports; None: the whole images.

    Raises:
        ConfigError: as `check_crop`.
        InputError: an image cannot be read.
    """
    check_crop(crop, encoder)
    if crop == NO_CROP:
        return None
    some = np.unique(np.linspace(0, len(traverse) - 1, min(SAMPLED, len(traverse))).astype(np.int64))
    border = common_border(map(border_of, traverse.take(some).images()))
    if not any(border):
        return None
    squeezed = border.near(Border(border.bottom, border.top, border.right, border.left), traverse.load(0), ALIKE)
    pixels = ", ".join(f"{side} {bar}" for side, bar in border._asdict().items() if bar)
    how = "cropped, as those of squeezed images" if squeezed else "masked, as painted over them"
    tell(f"note: {shown(traverse.source)}: bars at the edges ({pixels} pixels) are {how}")

    def framed(image: NDArray[np.uint8]) -> Framed:
        if squeezed:
            return border.inside(image), None
        return masked(border, image, encoder)

    return framed


class OfQueries:
    """What is encoded of the queries of a drive, in order, which may have bars.

    Args:
        references: What inputs respond to the references, float32 (n, inputs).
        encoder: Settings.
    """

    def __init__(self, references: NDArray[np.float32], encoder: EncoderConfig) -> None:
        self._references, self._encoder = references, encoder
        self._recent, self._shape = deque[Border](maxlen=RECENT), tuple[int, ...]()
        self._border, self._held = Border(), 0
        self._fits: NDArray[np.float64] | float = 0.0

    def __call__(self, image: NDArray[np.uint8]) -> Framed:
        """What is encoded of the next query; without bars it is the query itself."""
        if image.shape[:2] != self._shape:
            self._shape, self._border = image.shape[:2], Border()
            self._recent.clear()
        self._recent.append(border_of(image))
        border = common_border(self._recent)
        if not any(border):
            return image, None
        if not border.near(self._border, image, ALIKE):
            self._border, self._fits, self._held = border, 0.0, 0
        ways: list[Framed] = [(self._border.inside(image), None), masked(self._border, image, self._encoder)]
        if not self._seen_at_edges[np.array(self._border) > 0].any():
            ways.append((image, None))  # references have bars there, too
        if self._held < HELD:
            self._fits, self._held = self._fits + np.array([self._fit(*way) for way in ways]), self._held + 1
        return ways[int(np.argmax(self._fits))]

    @cached_property
    def _energy(self) -> NDArray[np.float32]:
        """Squares of the responses to each reference, over all channels, float32 (n, points)."""
        layout = self._encoder.layout
        return np.square(self._references).reshape(-1, layout.channels, layout.grid**2).sum(axis=1)

    @cached_property
    def _seen_at_edges(self) -> NDArray[np.bool_]:
        """Whether most references have anything at the top, the bottom, the left and the right edge, bool (4,)."""
        grid = self._encoder.layout.grid
        rows = self._energy.reshape(-1, grid, grid)
        edges = (rows[:, 0], rows[:, -1], rows[..., 0], rows[..., -1])
        return np.array([np.median(edge.any(axis=1)) > 0 for edge in edges])

    def _fit(self, image: NDArray[np.uint8], heard: NDArray[np.bool_] | None) -> float:
        """The largest cosine of an image and a reference, by the inputs that are not silent."""
        activity, energy = activity_of(image, self._encoder), self._energy
        if heard is not None:
            activity, energy = activity * heard, energy * heard[: energy.shape[1]]
        lengths = np.sqrt(energy.sum(axis=1)) * np.float32(math.sqrt(activity @ activity))
        return float((np.einsum("ij,j->i", self._references, activity) / np.maximum(lengths, 1e-6)).max())


def masked(border: Border, image: NDArray[np.uint8], encoder: EncoderConfig) -> Framed:
    """An image without its bars, under which inputs are silent."""
    layout = encoder.layout
    return border.replaced(image), np.tile(border.shows(image, layout.grid).ravel(), layout.channels)
