"""The one table of formats that networks are exchanged in, a row for each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lava_vpr.errors import InputError
from lava_vpr.exchange.drawn import Drawn
from lava_vpr.model import IntegerModel
from lava_vpr.rows.registry import Registry
from lava_vpr.storage.text import shown

TIME_STEP = 1e-4
"""Seconds of a step where nothing else is said: for it snnTorch takes a graph's time constants to be meant."""


@dataclass(frozen=True)
class Asked:
    """What is asked of a file besides its path.

    Attributes:
        time_step: Seconds of a step, for formats with time constants.
        references: Whether the file takes along what the network alone does not say: settings, names of the places,
            reference responses, what baselines and reports need.
    """

    time_step: float = TIME_STEP
    references: bool = True


@dataclass(frozen=True)
class FormatRow:
    """A format.

    Attributes:
        name: Its name, as ``--format`` takes it.
        title: What it is, for people.
        endings: How names of its files end, with the dot, in small letters.
        write: Writes a model's network to a path, complete or not at all; returns notes for people.
        read: The network in the file at a path; the number is the seconds of a step where the file does not say.
    """

    name: str
    title: str
    endings: tuple[str, ...]
    write: Callable[[IntegerModel, Path, Asked], tuple[str, ...]]
    read: Callable[[Path, float], Drawn]


FORMATS: Registry[FormatRow] = Registry("format", InputError)
"""Every format by name."""


def _write_nir(model: IntegerModel, path: Path, asked: Asked) -> tuple[str, ...]:
    """See `lava_vpr.exchange.nir_writing.write`."""
    from lava_vpr.exchange import nir_writing  # only who exchanges networks waits for HDF5

    return nir_writing.write(model, path, asked.time_step, references=asked.references)


def _read_nir(path: Path, time_step: float) -> Drawn:
    """See `lava_vpr.exchange.nir_reading.read`."""
    from lava_vpr.exchange import nir_reading

    return nir_reading.read(path, time_step)


FORMATS.register(
    FormatRow(
        "nir",
        "NIR, the Neuromorphic Intermediate Representation: a graph of Affine, LIF and Linear nodes",
        endings=(".nir",),
        write=_write_nir,
        read=_read_nir,
    )
)


def _write_netx(model: IntegerModel, path: Path, asked: Asked) -> tuple[str, ...]:
    """See `lava_vpr.exchange.netx.write`."""
    from lava_vpr.exchange import netx

    return netx.write(model, path, references=asked.references)


def _read_netx(path: Path, time_step: float) -> Drawn:
    """See `lava_vpr.exchange.netx.read`; it counts steps."""
    from lava_vpr.exchange import netx

    return netx.read(path)


FORMATS.register(
    FormatRow(
        "netx",
        "NetX, the HDF5 file of lava-dl: one recurrent population, with biases in whole weights",
        endings=(".net", ".h5", ".hdf5"),
        write=_write_netx,
        read=_read_netx,
    )
)


def format_of(path: Path, name: str | None = None) -> FormatRow:
    """The format of the file at ``path``: the one called ``name``, else the one whose ending the path has.

    Raises:
        InputError: no format has that name or ending.
    """
    if name is not None:
        return FORMATS[name]
    for row in FORMATS.values():
        if path.name.lower().endswith(row.endings):
            return row
    endings = ", ".join(ending for row in FORMATS.values() for ending in row.endings)
    raise InputError(f"{shown(path)}: no format has names that end so; name it {endings}, or say which with --format")
