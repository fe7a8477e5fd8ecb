"""What an image has in common with all that a map has seen.

The activity a of its inputs, of length 1, is compared with the mean M of the references':

* What is ``unlike``: the deficit of cos(a, M), in units of `DEFICIT` standard deviations of what it is of each
  reference and the others; or the share of the references' energy in rows and columns at the edges in which the image
  has none at all, and references have, in units of `EDGE`. From 1 on, an image is farther than those of another season.
* What is turned: a mirror, or a camera upside down, permutes orientation channels (`turns`). M speaks first: over a
  run, images turned back fit it better. Then the places do: the best cosine of an image with a reference is larger
  once it is turned back (`lava_vpr.inputs.doubts` takes means over runs).

The numbers were chosen on Nordland 0:200, in both seasons, and Gardens Point 0:50, both sides; but for those that
decide whether a run is turned (`lava_vpr.inputs.doubts.SURE`). ``python -m benchmarks robot.disturbed`` prints what
they reach.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

DEFICIT, LEAST_SPREAD = 5.0, 0.03
EDGE = 0.02
_SHARED, _TOGETHER, _ASYMMETRY, _PARTS, _AGREED = 0.01, 1024, 0.005, 4, 0.78


def turns(channels: int, grid: int) -> tuple[NDArray[np.int64], ...]:
    """Where each input of an image finds what it responds to once the image is mirrored, turned upside down (by 180
    degrees), or both; int64 (inputs,) each.

    Channel k of ``channels`` responds to gradients at 180 k / channels degrees, of which a mirror makes 180 less.
    """
    inputs = np.arange(channels * grid * grid).reshape(channels, grid, grid)
    mirrored = inputs[-np.arange(channels) % channels]
    return mirrored[:, :, ::-1].ravel(), inputs[:, ::-1, ::-1].ravel(), mirrored[:, ::-1].ravel()


@dataclass(frozen=True, eq=False)
class Likeness:
    """What the references of a map have in common.

    Attributes:
        references: Input responses to them, float32 (n, inputs).
        norms: Lengths of these, float32 (n,), at least a tiny one.
        layout: Channels, and points on a side of their grid.
        mean: Their mean direction, of length 1, and the differences between the mean and the mean of them turned each
            way, float32 (1 + turns, inputs).
        typical, spread: Mean and standard deviation of a reference's cosine to the mean of the others.
        asymmetry: Mean of what ``mean`` says of a reference and the others turned each way, float64 (turns,); infinite
            where that is next to nothing, and of a mirror where the quarters of the map do not agree on it.
        rows, columns: Share of their energy in each row and column of the grid; 0 where some have none.
    """

    references: NDArray[np.float32] = field(repr=False)
    norms: NDArray[np.float32] = field(repr=False)
    layout: tuple[int, int]
    mean: NDArray[np.float32] = field(repr=False)
    typical: float
    spread: float
    asymmetry: NDArray[np.float64]
    rows: NDArray[np.float64]
    columns: NDArray[np.float64]

    @classmethod
    def of(cls, activity: NDArray[np.float32], channels: int, grid: int) -> Likeness:
        """What references with ``activity`` (n, inputs), at least two, have in common."""
        whole, ways = activity, turns(channels, grid)
        lengths = np.maximum(np.sqrt(np.einsum("ij,ij->i", whole, whole)), np.float32(1e-6))
        every = -(-len(whole) // _TOGETHER)  # a thousand say what all have in common
        activity, norms = whole[::every], lengths[::every]
        n = len(activity)
        unit = activity / norms[:, None]
        total = unit.sum(axis=0, dtype=np.float64)
        differences = np.stack([total, *(total - total[way] for way in ways)])
        common = np.stack([np.einsum("ij,j->i", unit, one) for one in differences], axis=1)
        own = np.stack([np.ones(n), *(1 - np.einsum("ij,ij->i", unit, unit[:, way]) for way in ways)], axis=1)
        others = common - own  # of each reference with the sum of all but itself
        square = float(total @ total)
        cosines = others[:, 0] / np.sqrt(np.maximum(square - 2 * common[:, 0] + 1, 1e-12))
        shares = [_shares(activity, channels, grid, axis) for axis in (2, 1)]
        length, asymmetry = max(math.sqrt(square), 1e-12), others[:, 1:].mean(axis=0) / max(n - 1, 1)
        parts = np.stack([part.mean(axis=0) for part in np.array_split(unit, min(n, _PARTS))])
        between = parts @ (parts - parts[:, ways[0]]).T
        agreed = (between.sum() - between.trace()) / max(between.size - len(parts), 1)
        shared = asymmetry > _ASYMMETRY
        shared[0] &= agreed > _AGREED * asymmetry[0]
        scale = np.array([1 / length, *([1 / n] * len(ways))])
        return cls(
            references=whole,
            norms=lengths,
            layout=(channels, grid),
            mean=(differences * scale[:, None]).astype(np.float32),
            typical=float(cosines.mean()),
            spread=max(float(cosines.std()), LEAST_SPREAD),
            asymmetry=np.where(shared, asymmetry, np.inf),
            rows=shares[0],
            columns=shares[1],
        )

    def edges(self, activity: NDArray[np.float32]) -> float:
        """Share of the references' energy in rows and columns at the edges in which an image has none; 1: it has none.

        Args:
            activity: Its input responses, float32 (inputs,).
        """
        inside = self._inside(activity)
        if inside is None:
            return 1.0
        return float(
            sum(
                some[: part.start].sum() + some[part.stop :].sum()
                for some, part in zip((self.rows, self.columns), inside, strict=True)
            )
        )

    def seen(self, activity: NDArray[np.float32]) -> float:
        """Length of the mean direction in the rows and columns between the edges in which an image has nothing."""
        channels, grid = self.layout
        inside = self._inside(activity)
        if inside is None:
            return 1.0
        rows, columns = inside
        return float(np.linalg.norm(self.mean[0].reshape(channels, grid, grid)[:, rows, columns]))

    def _inside(self, activity: NDArray[np.float32]) -> tuple[slice, slice] | None:
        """The rows and columns from the first to the last in which an image has anything; None: there are none."""
        channels, grid = self.layout
        energy = activity.reshape(channels, grid, grid).sum(axis=0)
        if not energy.any():
            return None
        rows, columns = (np.flatnonzero(energy.any(axis=axis)) for axis in (1, 0))
        return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)

    def better_turned(self, unit: NDArray[np.float32], way: int) -> float:
        """By how much the best cosine of a reference and an image, of length 1, is larger once the image is turned."""
        turned = unit[turns(*self.layout)[way]]
        found = [float((np.einsum("ij,j->i", self.references, one) / self.norms).max()) for one in (turned, unit)]
        return found[0] - found[1]


def _shares(activity: NDArray[np.float32], channels: int, grid: int, axis: int) -> NDArray[np.float64]:
    """Mean share of the energy of each row (``axis`` 2) or column (1); 0 where more than a few images have none."""
    energy = activity.reshape(len(activity), channels, grid, grid).sum(axis=1).sum(axis=axis, dtype=np.float64)
    shares = energy / np.maximum(energy.sum(axis=1, keepdims=True), 1e-12)
    return np.where((energy == 0).mean(axis=0) > _SHARED, 0.0, shares.mean(axis=0))
