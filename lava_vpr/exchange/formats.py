"""The one table of formats that networks are exchanged in, a row for each."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from lava_vpr.errors import InputError, shown
from lava_vpr.exchange.drawn import Drawn, UnfitNetwork
from lava_vpr.model import IntegerModel
from lava_vpr.rows.registry import Registry
from lava_vpr.storage.writing import write_atomically

TIME_STEP = 1e-4
"""Seconds of a step where nothing else is said: for it snnTorch takes a graph's time constants to be meant."""


@dataclass(frozen=True)
class FileOptions:
    """What is asked of a file besides its path.

    Attributes:
        time_step: Seconds of a step, for formats with time constants.
        references: Whether the file takes along what the network alone does not say: settings, names of the places,
            reference responses, what baselines and reports need.
    """

    time_step: float = TIME_STEP
    references: bool = True


def _module(name: str) -> ModuleType:
    """A module beside this one: only who exchanges networks waits for the packages of a format."""
    return importlib.import_module(f"lava_vpr.exchange.{name}")


@dataclass(frozen=True)
class FormatRow:
    """A format.

    Attributes:
        name: Its name, as ``--format`` takes it.
        title: What it is, for people.
        endings: How names of its files end, with the dot, in small letters.
        holds: What a file holds, for messages.
        remedy: What to do about a file that holds no network of this shape.
        writer: The module here whose ``content(model, options)`` makes a file's content of a model's network, and notes
            for people.
        reader: The module here whose ``network(file, time_step)`` is the network in a file's content, as
            `lava_vpr.storage.hdf5.read` reads it; the number is the seconds of a step where the file does not say.
    """

    name: str
    title: str
    endings: tuple[str, ...]
    holds: str
    remedy: str
    writer: str
    reader: str

    def write(self, model: IntegerModel, path: Path, options: FileOptions) -> tuple[str, ...]:
        """Write the network of ``model`` to ``path``, complete or not at all.

        Returns:
            Notes for people: what the file does not hold as the model does.
        Raises:
            NetworkLimitError: the format has no place for the network.
            InputError: it cannot be written, or would be larger than what is read.
        """
        try:
            content, notes = _module(self.writer).content(model, options)
            write_atomically(path, lambda file: file.write(content))
        except UnfitNetwork as error:
            raise InputError(f"{shown(path)}: the {self.holds} {error}") from None
        except OSError as error:
            raise InputError(
                f"{shown(path)}: the {self.holds} cannot be written ({error.strerror}); free space or choose another "
                "place"
            ) from None
        return tuple(notes)

    def read(self, path: Path, time_step: float) -> Drawn:
        """The network in the file at ``path``.

        Args:
            path: The file.
            time_step: Seconds of a step, where the file does not say.
        Raises:
            InputError: it cannot be read (`lava_vpr.storage.hdf5`), or holds no network of this shape.
        """
        from lava_vpr.storage import hdf5  # only who exchanges networks waits for HDF5

        file = hdf5.read(path, self.holds)
        try:
            drawn: Drawn = _module(self.reader).network(file, time_step)
        except UnfitNetwork as error:
            raise InputError(f"{shown(path)}: the {self.holds} {error}; {self.remedy}") from None
        return drawn


FORMATS: Registry[FormatRow] = Registry("format", InputError)
"""Every format by name."""


FORMATS.register(
    FormatRow(
        "nir",
        "NIR, the Neuromorphic Intermediate Representation: a graph of Affine, LIF and Linear nodes",
        endings=(".nir",),
        holds="NIR graph",
        remedy="give a graph Input -> Affine -> LIF -> Output with at most one recurrent Linear (docs/exchange.md)",
        writer="nir_writing",
        reader="nir_reading",
    )
)


FORMATS.register(
    FormatRow(
        "netx",
        "NetX, the HDF5 file of lava-dl: one recurrent population, with biases in whole weights",
        endings=(".net", ".h5", ".hdf5"),
        holds="NetX file",
        remedy="give one with a single dense CUBA layer",
        writer="netx",
        reader="netx",
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
