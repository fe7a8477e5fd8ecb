"""Compiled kernels from pixels to rates: means of areas, smoothing, orientation channels, rates.

Their arithmetic is the same bits on every machine: single precision but where they say otherwise, in the order of sums
that OpenCV (``resize``, ``GaussianBlur``, ``blur``) and NumPy (``sum``) have on a processor that fuses a product and a
sum, and fused whether a processor can or not.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled, imported

_BLOCK, _CHUNK = 128, 8192
"""Values whose sum NumPy takes in eight lanes, and those of one call of its loop."""

_ONE = np.uint64(1)  # unsigned indices spare the compiler NumPy's wrap-around of negative ones
_DUST = 1e-3
"""Shares of a pixel that OpenCV leaves out."""
_FOLD = math.tan(math.pi / 8)
_P = (-8.750608600031904122785e-1, -1.615753718733365076637e1, -7.500855792314704667340e1)
_P_LOW = (-1.228866684490136173410e2, -6.485021904942025371773e1)
_Q = (2.485846490142306297962e1, 1.650270098316988542046e2, 4.328810604912902668951e2)
_Q_LOW = (4.853903996359136964868e2, 1.945506571482613964425e2)

_numba = imported()


@_numba.extending.intrinsic
def _fma(context: Any, a: Any, b: Any, c: Any) -> Any:
    """The processor's fused product and sum."""

    def made(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fma(*values)

    return _numba.float32(_numba.float32, _numba.float32, _numba.float32), made


def fused(a: np.float32, b: np.float32, c: np.float32) -> np.float32:
    """``a b + c`` rounded once; here, where kernels are not compiled, nearly always."""
    return np.float32(np.float64(a) * np.float64(b) + np.float64(c))


@_numba.extending.overload(fused, strict=False)
def _fused(a: Any, b: Any, c: Any) -> Any:
    return lambda a, b, c: _fma(a, b, c)


@compiled(error_model="numpy")
def _shares(pixels: int, cells: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """The pixels that each of ``cells`` lies on: the first, how many, and their shares in it, float32 (cells, k)."""
    scale = 1.0 / (cells / pixels)
    first, many = np.empty(cells, np.int64), np.zeros(cells, np.int64)
    shares = np.empty((cells, int(scale) + 3), np.float32)
    for k in range(cells):
        begin, end = k * scale, k * scale + scale
        width, last = min(scale, pixels - begin), min(math.floor(end), pixels - 1)
        whole = min(math.ceil(begin), last)
        first[k] = whole
        if whole - begin > _DUST:
            first[k], shares[k, 0], many[k] = whole - 1, (whole - begin) / width, 1
        for _ in range(whole, last):
            shares[k, many[k]] = 1.0 / width
            many[k] += 1
        if end - last > _DUST:
            shares[k, many[k]] = min(end - last, 1.0, width) / width
            many[k] += 1
    return first, many, shares


@compiled(error_model="numpy")
def _in_order(pixels: NDArray[np.uint8], down: NDArray[np.float32], across: NDArray[np.float32]) -> float:
    """One mean as OpenCV adds it up, in single precision: pixel after pixel, then row after row."""
    total = np.float32(0)
    for y in range(down.size):
        part = np.float32(0)
        for x in range(across.size):
            part += np.float32(pixels[y, x]) * across[x]
        total += down[y] * part
    return float(total)


@compiled(nogil=True, error_model="numpy")
def area_means(image: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """``image`` (h, w, c) made smaller by the means of areas, (height, width, c), as OpenCV's ``INTER_AREA`` has it.

    Means are added up row by row, in the order that is fast, and again in OpenCV's where those that are within both
    errors could be rounded either way.
    """
    colours = image.shape[2]
    top, tall, down = _shares(image.shape[0], height)
    left, wide, across = _shares(image.shape[1], width)
    made, means = np.empty((height, width, colours), np.uint8), np.empty(image.shape[1] * colours, np.float32)
    doubt = 2.0**-15 * (across.shape[1] + 2 * down.shape[1])  # twice 2^-24 of 256 for each sum and product of either
    for y in range(height):
        means[:] = 0
        for k in range(tall[y]):
            row, share = image[top[y] + k].reshape(-1), down[y, k]
            for j in range(means.size):
                means[j] += share * np.float32(row[j])
        for x in range(width):
            for c in range(colours):
                value, begin = 0.0, left[x] * colours + c
                for k in range(wide[x]):
                    value += across[x, k] * np.float64(means[begin + k * colours])
                if abs(value - math.floor(value) - 0.5) < doubt:
                    seen = image[top[y] : top[y] + tall[y], left[x] : left[x] + wide[x], c]
                    value = _in_order(seen, down[y, : tall[y]], across[x, : wide[x]])
                made[y, x, c] = np.uint8(min(np.rint(value), 255.0))
    return made


@compiled(error_model="numpy")
def _reflected(k: int, side: int) -> int:
    """Where a pixel beyond an edge is looked for: mirrored at the last one, as often as it takes."""
    while side > 1 and (k < 0 or k >= side):
        k = -k if k < 0 else 2 * (side - 1) - k
    return k if side > 1 else 0


@compiled(error_model="numpy")
def _mirror(side: int, reach: int) -> NDArray[np.int64]:
    """Where each pixel of a row is looked for that goes ``reach`` pixels on at either end."""
    found = np.empty(side + 2 * reach, np.int64)
    for k in range(found.size):
        found[k] = _reflected(k - reach, side)
    return found


@compiled(error_model="numpy")
def _lengthened(row: NDArray[Any], mirror: NDArray[np.int64], line: NDArray[Any]) -> None:
    """Fill ``line`` with a row and what goes on at its ends."""
    reach = (line.size - row.size) // 2
    for x in range(row.size):
        line[reach + x] = row[x]
    for k in range(reach):
        line[k] = row[mirror[k]]
        line[reach + row.size + k] = row[mirror[reach + row.size + k]]


@compiled(nogil=True, error_model="numpy")
def smoothed(grey: NDArray[np.uint8], taps: NDArray[np.float32]) -> NDArray[np.float32]:
    """``grey`` (side, side) smoothed along both sides, float32.

    Args:
        grey: The image.
        taps: Weights, symmetric, an odd number.
    """
    side, reach = grey.shape[0], taps.size // 2
    mirror = _mirror(side, reach)
    across, line = np.empty((side, side), np.float32), np.empty(mirror.size, np.float32)
    for y in range(side):
        row = across[y]
        _lengthened(grey[y], mirror, line)
        if reach > 2 or reach == 0:
            for x in range(side):
                row[x] = line[x] * taps[0]
            for k in range(1, taps.size):
                tap, shifted = taps[k], line[k : k + side]
                for x in range(side):
                    row[x] = fused(shifted[x], tap, row[x])
        else:
            for x in range(side - side % 2):
                outer = np.float32(line[x + reach - 1] + line[x + reach + 1]) * taps[reach + 1]
                row[x] = fused(line[x + reach], taps[reach], outer)
                if reach == 2:
                    row[x] = fused(np.float32(line[x] + line[x + 4]), taps[4], row[x])
            for x in range(side - side % 2, side):  # what OpenCV's loop over pairs leaves
                row[x] = line[x + reach] * taps[reach]
                for k in range(1, reach + 1):
                    row[x] = fused(np.float32(line[x + reach - k] + line[x + reach + k]), taps[reach + k], row[x])
    made = np.empty((side, side), np.float32)
    for y in range(side):
        row, middle = made[y], across[y]
        for x in range(side):
            row[x] = middle[x] * taps[reach]
        for k in range(1, reach + 1):
            tap, above, below = taps[reach + k], across[mirror[reach + y - k]], across[mirror[reach + y + k]]
            for x in range(side):
                row[x] = fused(np.float32(above[x] + below[x]), tap, row[x])
    return made


@compiled(error_model="numpy")
def _lanes(values: NDArray[Any]) -> Any:
    """The sum of up to `_BLOCK` values: in eight lanes, and those left over behind."""
    lanes, whole = np.zeros(8, values.dtype), values.size - values.size % 8
    for begin in range(0, whole, 8):
        for k in range(8):
            lanes[k] += values[begin + k]
    total = ((lanes[0] + lanes[1]) + (lanes[2] + lanes[3])) + ((lanes[4] + lanes[5]) + (lanes[6] + lanes[7]))
    for k in range(whole, values.size):
        total += values[k]
    return total


@compiled(error_model="numpy")
def _sum(values: NDArray[Any]) -> Any:
    """The sum of a row in its own precision, chunk by chunk; a chunk is halved until a block is left.

    Of a chunk and of the halves in it that are begun, ``ends`` are where they end, ``parts`` their first halves' sums.
    """
    ends, parts, halved = np.empty(16, np.int64), np.empty(16, values.dtype), np.zeros(16, np.bool_)
    total = values.dtype.type(0)
    for begin in range(0, values.size, _CHUNK):
        ends[0], depth = min(begin + _CHUNK, values.size), 0
        while begin < ends[0]:
            n = ends[depth] - begin
            if n > _BLOCK:
                halved[depth], ends[depth + 1] = False, begin + n // 2 - n // 2 % 8
                depth += 1
                continue
            part, begin = _lanes(values[begin : ends[depth]]), ends[depth]
            while depth > 0 and halved[depth - 1]:
                depth -= 1
                part = parts[depth] + part
            if depth > 0:
                parts[depth - 1], halved[depth - 1], ends[depth] = part, True, ends[depth - 1]
            else:
                total += part
    return total


@compiled(error_model="numpy")
def _gradient(
    seen: NDArray[np.float32], gx: NDArray[np.float32], gy: NDArray[np.float32], magnitude: NDArray[np.float32]
) -> None:
    """Central differences and their magnitude; at an edge, which is mirrored, there is none across it."""
    side = seen.shape[0]
    for y in range(side):
        row, above, below = seen[y], seen[_reflected(y - 1, side)], seen[_reflected(y + 1, side)]
        gx[y, 0], gx[y, side - 1] = np.float32(0), np.float32(0)
        for x in range(1, side - 1):
            gx[y, x] = row[x + 1] - row[x - 1]
        for x in range(side):
            gy[y, x] = below[x] - above[x]
            magnitude[y, x] = math.sqrt(np.float32(gx[y, x] * gx[y, x]) + np.float32(gy[y, x] * gy[y, x]))


@compiled(error_model="numpy")
def _box_means(values: NDArray[np.float32], window: int, out: NDArray[np.float32]) -> None:
    """The mean of each ``window`` x ``window`` square, by running sums in double precision."""
    side, scale = values.shape[0], 1.0 / (window * window)
    mirror = _mirror(side, window // 2)
    rows, column, line = np.empty((side, side)), np.zeros(side), np.empty(mirror.size)
    for y in range(side):
        row = rows[y]
        _lengthened(values[y], mirror, line)
        for x in range(side if window <= 5 else 1):
            row[x] = line[x]
            for k in range(1, window):
                row[x] += line[x + k]
        total = row[0]
        for x in range(side if window <= 5 else 1, side):
            total += line[x + window - 1] - line[x - 1]
            row[x] = total
    for k in range(window - 1):
        for x in range(side):
            column[x] += rows[mirror[k], x]
    for y in range(side):
        entering, leaving = rows[mirror[y + window - 1]], rows[mirror[y]]
        for x in range(side):
            total = column[x] + entering[x]
            out[y, x] = total * scale
            column[x] = total - leaving[x]


@compiled(error_model="numpy")
def _arctangent(t: float) -> float:
    """The arctangent of a magnitude up to tan(pi / 8), to the last bit or so; source: Cephes, ``atan.c``."""
    z = t * t
    above = ((((_P[0] * z + _P[1]) * z + _P[2]) * z + _P_LOW[0]) * z + _P_LOW[1]) * z
    return t + t * (above / (((((z + _Q[0]) * z + _Q[1]) * z + _Q[2]) * z + _Q_LOW[0]) * z + _Q_LOW[1]))


@compiled(nogil=True, error_model="numpy")
def channels(
    grey: NDArray[np.uint8], taps: NDArray[np.float32], cell: int, orientations: int, window: int, floor: np.float32
) -> NDArray[np.float32]:
    """Responses (orientations, grid, grid) to an image; see `lava_vpr.inputs.orientation.orientation_channels`.

    Args:
        grey, taps: As in `smoothed`.
        cell: Pixels of a cell's side, a divisor of the image's.
        orientations: Number of directions.
        window: Pixels of the side of the window whose mean magnitude divides.
        floor: Share of the whole image's mean that is added to the window's.
    """
    seen, side, grid = smoothed(grey, taps), grey.shape[0], grey.shape[0] // cell
    gx, gy = np.empty((side, side), np.float32), np.empty((side, side), np.float32)
    magnitude, pool = np.empty((side, side), np.float32), np.empty((side, side), np.float32)
    _gradient(seen, gx, gy, magnitude)
    _box_means(magnitude, window, pool)
    share = floor * np.float32(np.float64(_sum(magnitude.reshape(-1))) / magnitude.size)
    below, lower, upper = np.empty(side, np.uint64), np.empty(side, np.float32), np.empty(side, np.float32)
    best, made = np.empty((grid, orientations + 2), np.float32), np.empty((orientations, grid, grid), np.float32)
    per = orientations / math.pi
    for y in range(side):
        if y % cell == 0:
            best[:] = 0
        for x in range(side):
            high = np.float32(np.float32(pool[y, x] + share) + np.float32(1e-3))
            energy = max(min(magnitude[y, x] / high, np.float32(4)) - np.float32(0.3), np.float32(0))
            # float64: a last-bit difference between mathematical libraries then cannot reach a 16-bit rate.
            across, down = np.float64(abs(gx[y, x])), np.float64(abs(gy[y, x]))
            least, most = (across, down) if across < down else (down, across)
            turned = least > _FOLD * most
            whole = least + most if turned else most
            angle = _arctangent((least - most if turned else least) / (whole if whole > 0 else 1.0))
            angle = angle + math.pi / 4 if turned else angle
            angle = math.pi / 2 - angle if down > across else angle
            position = (math.pi - angle if (gx[y, x] < 0) != (gy[y, x] < 0) else angle) * per
            below[x] = np.uint64(position)
            upper[x] = np.float32(energy * np.float32(position - np.float64(below[x])))
            lower[x] = energy - upper[x]
        for c in range(grid):
            near = best[c]
            for x in range(c * cell, (c + 1) * cell):
                k = below[x]
                near[k] = lower[x] if lower[x] > near[k] else near[k]
                near[k + _ONE] = upper[x] if upper[x] > near[k + _ONE] else near[k + _ONE]
        if (y + 1) % cell == 0:
            for x in range(grid):
                best[x, 0] = max(best[x, 0], best[x, orientations])
                best[x, 1] = max(best[x, 1], best[x, orientations + 1])
                for k in range(orientations):
                    made[k, y // cell, x] = best[x, k]
    return made


@compiled(error_model="numpy")
def _least_kept(values: NDArray[np.float32], count: int) -> np.float32:
    """The ``count``-th largest of values that are at least 0, bit after bit: they are ordered as their bits are."""
    bits, found = values.view(np.int32), np.zeros(1, np.int32)
    for place in range(30, -1, -1):
        more, least = 0, np.int32(found[0] | np.int32(1 << place))
        for k in range(bits.size):
            more += bits[k] >= least
        if more >= count:
            found[0] = least
    return found.view(np.float32)[0]


@compiled(nogil=True, error_model="numpy")
def shared_out(activity: NDArray[np.float32], count: int, spikes: float) -> NDArray[np.uint16]:
    """Rates uint16 (n, inputs) of responses; see `lava_vpr.engine.rates.rates16`.

    Args:
        activity: Responses, float32 (n, inputs), at least 0.
        count: How many of each image's count, and those equal to the least of them; 0: all.
        spikes: Expected spikes of all inputs together in one step.
    """
    rates, values = np.zeros(activity.shape, np.uint16), np.empty(activity.shape[1], np.float64)
    for n in range(activity.shape[0]):
        row = activity[n]
        least = _least_kept(row, count) if 0 < count < row.size else np.float32(0)
        for k in range(row.size):
            values[k] = row[k] if row[k] >= least else np.float32(0)
        total = _sum(values)
        if total > 0:
            for k in range(row.size):
                rates[n, k] = np.uint16(min(np.rint(values[k] / total * (spikes * 65536.0)), 65535.0))
    return rates
