"""The registry of backends; everything that the program knows about a backend is in its row.

Every backend runs the model's own network spec and has no parameters of its own; equal model, rates and seed give equal
counts, bit for bit, on every exact backend.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from itertools import starmap

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import Advance, Backend, BackendRow, FromPixels, HostBackend, front_end_of
from lava_vpr.backends.lava import LavaBackend, front_end_trains, gained, lava_missing, loihi2_missing
from lava_vpr.cluster.tasks import Pool
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.model import Model
from lava_vpr.rows.registry import Registry

BACKENDS: Registry[BackendRow] = Registry(
    "backend", BackendUnavailableError, group="lava_vpr.backends", row_class=BackendRow
)
"""Every backend by name; the others are compared with the first."""


def _bundle(threads: int, advance: Advance | None) -> Backend:
    """The backend that simulates bundles."""
    from lava_vpr.backends.deployed import BundleBackend  # a slow import, which only bundles need

    return BundleBackend(advance)


def _bundle_front_end(
    model: Model, blocks: Iterable[PixelBlock], advance: Advance | None
) -> Iterator[Mapping[str, NDArray[np.uint8]]]:
    """The spikes of the front end in a bundle, block by block."""
    from lava_vpr.backends.deployed import front_end_trains as simulated

    return simulated(model, blocks, advance)


def _kapoho_bay(threads: int, advance: Advance | None) -> Backend:
    """The backend that runs bundles on Kapoho Bay."""
    from lava_vpr.backends.deployed import KapohoBayBackend

    return KapohoBayBackend(advance)


def _kapoho_bay_missing() -> str | None:
    """The reason why Kapoho Bay cannot be used here, with the remedy; None if it can."""
    from lava_vpr.deploy.bundle.board_program import kapoho_bay_available

    return kapoho_bay_available()


for _row in (
    BackendRow(
        "host",
        "compiled engine on this machine's processor, bit-exact integers",
        hosts_kernel=True,
        make=lambda threads, advance: HostBackend(Pool(threads)),
        unavailable=lambda: None,
        timing="compiled",
        default=True,
        together=256,
        front_end=lambda model, blocks, advance: starmap(front_end_of(model).trains, blocks),
    ),
    BackendRow(
        "lava-fixed",
        "Lava Processes in Loihi's integers, Loihi 2 simulation configuration",
        make=lambda _, advance: LavaBackend("lava-fixed", "composed", advance=advance),
        unavailable=lava_missing,
        timing="lava",
        default=True,
        limit=16,
        front_end=partial(front_end_trains, "composed", "fixed_pt"),
        gains=partial(gained, "composed", "fixed_pt"),
    ),
    BackendRow(
        "lava-float",
        "the same Processes in floating point; preset paper, too",
        make=lambda _, advance: LavaBackend("lava-float", "composed", "floating_pt", advance=advance),
        unavailable=lava_missing,
        exact=False,
        timing="lava",
        limit=16,
        front_end=partial(front_end_trains, "composed", "floating_pt"),
        gains=partial(gained, "composed", "floating_pt"),
    ),
    BackendRow(
        "lava-fused",
        "one Lava Process that calls the host's own kernel, a presentation of many queries a step",
        hosts_kernel=True,
        make=lambda _, advance: LavaBackend("lava-fused", "fused", advance=advance),
        unavailable=lava_missing,
        timing="lava",
        default=True,
        batch=2560,
    ),
    BackendRow(
        "lava-library",
        "wired from Lava's own LIF, Dense and Sparse alone: what Intel's compiler can place",
        make=lambda _, advance: LavaBackend("lava-library", "library", advance=advance),
        unavailable=lava_missing,
        timing="lava",
        limit=16,
        front_end=partial(front_end_trains, "library", "fixed_pt"),
        gains=partial(gained, "library", "fixed_pt"),
    ),
    BackendRow(
        "bundle",
        "registers and memory of a deployed bundle, simulated (a model is deployed for Kapoho Bay first)",
        make=_bundle,
        unavailable=lambda: None,
        timing="compiled",
        default=True,
        limit=100,
        front_end=_bundle_front_end,
    ),
    BackendRow(
        "loihi2",
        "the library's network on a Loihi 2 board",
        make=lambda _, advance: LavaBackend("loihi2", "library", board=True, advance=advance),
        unavailable=loihi2_missing,
        board="loihi2",
        timing="board",
    ),
    BackendRow(
        "kapoho-bay",
        "a bundle on Kapoho Bay, by Intel's NxSDK",
        make=_kapoho_bay,
        unavailable=_kapoho_bay_missing,
        counts_only=True,
        board="kapoho-bay",
        timing="board",
    ),
):
    BACKENDS.register(_row)


def require(name: str, model: Model | None = None) -> None:
    """Refuse a backend that cannot run here, or cannot run ``model``, before any work is done.

    Raises:
        BackendUnavailableError: no backend has that name, its software or device is missing, or the model is a bundle
            for another board.
        ConfigError: the backend does not have the neuron model of ``model``.
    """
    row = BACKENDS[name]
    reason = row.unavailable()
    if reason is not None:
        raise BackendUnavailableError(reason)
    if model is None:
        return
    model.neuron_model.check(name)
    if row.board is not None and model.bundle is not None:
        from lava_vpr.deploy.bundle import folder

        target = folder.load(model.bundle).target
        if target != row.board:
            raise BackendUnavailableError(
                f"{model.bundle}: is a bundle for {target}, which {row.board} cannot run; deploy the model with "
                f"--target {row.board}"
            )


def get(name: str, threads: int = 1, advance: Advance | None = None) -> Backend:
    """The backend called ``name``.

    Args:
        name: Name in `BACKENDS`.
        threads: Threads of the backend.
        advance: Called by slow backends with the number of further presentations that are done.
    Raises:
        BackendUnavailableError: no backend has that name, or its software or device is missing.
    """
    require(name)
    row = BACKENDS[name]
    made = row.make(threads, advance)
    return made if row.front_end is None or name == "host" else FromPixels(made, row.front_end, advance)


def timed_by_default() -> tuple[str, ...]:
    """The names of the backends that ``bench`` times unless told otherwise; none needs a board."""
    return tuple(name for name, row in BACKENDS.items() if row.default)
