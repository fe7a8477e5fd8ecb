"""Which cores of a board a plan's cores become: positions on the mesh of tiles, with few hops between them.

Tile t of a chip is at column t // rows, row t % rows, as SANA-FE 2.2.9 numbers them; core c is on tile c // 4. A
message crosses as many tiles as columns and rows lie between. How the chips of a board are joined is not public: they
are taken to stand side by side, the second chip's column 0 beside the first one's last.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.mapping.sizing import Integers

_UNITS = 1 << 20
"""Steps from no message to the most messages between two cores, when exchanges are compared."""


def tiles(cores: Integers, board: Board) -> Integers:
    """Column and row of the tiles of ``cores`` (n, 2: chip, core), int64 (n, 2); columns go on from chip to chip.

    Raises:
        ValueError: the board's mesh is not public.
    """
    mesh = board.mesh
    if mesh is None:
        raise ValueError(f"the mesh of {board.title} is not public")
    tile = cores[:, 1] // mesh.tile_cores
    return np.stack([cores[:, 0] * mesh.columns + tile // mesh.rows, tile % mesh.rows], axis=1)


def distances(cores: Integers, board: Board) -> Integers:
    """Tiles between any two of ``cores`` (n, 2: chip, core), int64 (n, n)."""
    positions = tiles(cores, board)
    return np.asarray(np.abs(positions[:, None] - positions[None, :]).sum(axis=2))


def assign_cores(traffic: NDArray[np.float64], board: Board) -> tuple[Integers, float | None]:
    """Chip and core of each of a plan's cores.

    Starts with the tiles of a corner, as near to a square as they come, in the order given; then exchanges the two
    cores that save most, until none do. The first chip is filled before the second is touched.

    Args:
        traffic: Expected messages in a step from core to core, float64 (cores, cores).
        board: The board; it has at least so many cores.
    Returns:
        Chip and core, int64 (cores, 2); and expected tiles that messages cross in a step, None if the mesh is not
        public.
    """
    count = len(traffic)
    if board.mesh is None:
        numbers = np.arange(count)
        return np.stack([numbers // board.cores, numbers % board.cores], axis=1), None
    candidates = _candidates(count, board, board.mesh.tile_cores)
    between = distances(candidates, board).astype(np.float64)
    # Whole numbers: their sums are exact, so ties are ties on every machine.
    scale = _UNITS / max(float(traffic.max(initial=0.0)), 1e-12)
    flow = np.zeros((len(candidates), len(candidates)))
    flow[:count, :count] = np.round((traffic + traffic.T) * scale)
    np.fill_diagonal(flow, 0)
    order = _exchanged(flow, between)[:count]
    return candidates[order], float((traffic * between[np.ix_(order, order)]).sum())


def _candidates(count: int, board: Board, tile_cores: int) -> Integers:
    """Chips and cores that ``count`` cores may become, int64 (>= count, 2): whole chips, then a growing square."""
    chips, left = [], count
    numbers = np.arange(board.cores)
    positions = tiles(np.stack([np.zeros_like(numbers), numbers], axis=1), board)
    by_square = np.lexsort((numbers, positions.sum(axis=1), positions.max(axis=1)))
    for chip in range(-(-count // board.cores)):
        cores = by_square[: -(-left // tile_cores) * tile_cores]
        chips.append(np.stack([np.full(cores.size, chip), cores], axis=1))
        left -= board.cores
    return np.concatenate(chips)


def _exchanged(flow: NDArray[np.float64], between: NDArray[np.float64]) -> Integers:
    """The candidate of each core after exchanges, int64 (cores,); ``flow`` is symmetric."""
    order = np.arange(len(flow))
    while True:
        near = between[np.ix_(order, order)]
        reach = flow @ near
        now = np.diag(reach)
        change = reach + reach.T - now[:, None] - now[None, :] + 2 * flow * near
        best = int(np.argmin(change))
        i, k = divmod(best, len(flow))
        if change[i, k] >= 0:
            return order
        order[[i, k]] = order[[k, i]]
