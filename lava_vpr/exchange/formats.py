"""The one table of formats that networks are exchanged in, a row for each; and the model that a network from such a
file makes: with the references in the file, or those of a model."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import integer_config
from lava_vpr.configfile import of_file, to_dict, update
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import InputError, LavaVprError, ModelFileError, shown
from lava_vpr.exchange.drawn import Drawn, UnfitNetwork, digest, whole
from lava_vpr.model import IntegerModel, Model, assemble, lif_model
from lava_vpr.rows.registry import Registry
from lava_vpr.storage import container
from lava_vpr.storage.writing import write_atomically, written
from lava_vpr.training.measuring import calibrated, remeasured

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
            ConfigError: its neurons are not LIF.
        """
        model.neuron_model.check(f"format {self.name}")
        try:
            with written(path, f"the {self.holds} "):
                content, notes = _module(self.writer).content(model, options)
                write_atomically(path, lambda file: file.write(content))
        except UnfitNetwork as error:
            raise InputError(f"{shown(path)}: the {self.holds} {error}") from None
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


class Imported(NamedTuple):
    """A model made of a file, and what was changed on the way, for people."""

    model: Model
    notes: tuple[str, ...]


def imported(
    path: Path, row: FormatRow, like: Model | None = None, *, time_step: float = TIME_STEP, threads: int = 1
) -> Imported:
    """The model of the network in the file at ``path``.

    A file that was written from a model, and has not been altered since, makes that model again, byte for byte. Else
    the network answers with the settings and references of ``like``, or of the file; what they bring it is measured.

    Args:
        path: The file.
        row: Its format.
        like: A model with the same inputs and neurons, whose settings and references the network takes over.
        time_step: Seconds of a step, where the file does not say.
        threads: For the references' responses; does not change the result.
    Raises:
        InputError: it cannot be read, or holds no network that these neurons can be.
        ModelFileError: the references in it are no model's.
        ConfigError: ``like`` has other neurons than LIF.
        LavaVprError: the network is out of the range of the chip's registers.
    """
    source = None if like is None else lif_model(like, "a network in another format")
    drawn = row.read(path, time_step)
    if like is None and drawn.references is None:
        raise InputError(
            f"{shown(path)}: holds a network alone, and nothing says which place its neurons stand for; give "
            "--like MODEL, a model with as many inputs and neurons"
        )
    try:
        return _from_own(path, drawn, threads) if source is None else _from_model(drawn, source, threads)
    except ModelFileError:
        raise
    except LavaVprError as error:
        raise InputError(f"{shown(path)}: the network cannot be used ({error})") from None


def _from_own(path: Path, drawn: Drawn, threads: int) -> Imported:
    """The model that ``drawn`` makes with the references in its own file."""
    header, arrays = container.unpack(drawn.references or b"", path, "references")
    made = whole(drawn, integer_config(of_file(header.get("config")), "a network in another format").network)
    learned = arrays.get("learned", np.zeros((0, 0), np.float32))
    shape = (made.network.inputs, made.network.neurons)
    if learned.size and (learned.dtype != np.float32 or learned.shape != shape or not np.isfinite(learned).all()):
        raise ModelFileError(f"{shown(path)}: the float weights in it are no array {shape}; export the model again")
    kept = {**arrays, "learned": np.zeros((0, 0), np.float32)}
    unaltered = digest(made.network) == drawn.digest
    if unaltered:
        model = replace(assemble(path, header, kept, made.network), learned=learned)
        return Imported(model, made.notes)
    config = update(of_file(header["config"]), {"network": _of_weights(made.network)})
    header = {**header, "config": to_dict(config)}
    model = assemble(path, header, kept, made.network)
    return _remeasured(model, made.notes, threads)


def _of_weights(network: FixedNetwork) -> dict[str, object]:
    """The settings that the weights of ``network`` are of."""
    return {"weight_bits": network.bits, "signed": network.signed}


def _from_model(drawn: Drawn, like: IntegerModel, threads: int) -> Imported:
    """The model that ``drawn`` makes with the references of ``like``."""
    made = whole(drawn, like.config.network)
    own, other = like.network.weights.shape, made.network.weights.shape
    if own != other:
        raise InputError(
            f"{other[0]:,} inputs and {other[1]:,} neurons, but the model of --like has {own[0]:,} and {own[1]:,}; "
            "give one of the same size"
        )
    if digest(made.network) == digest(like.network):
        return Imported(replace(like, bundle=None), made.notes)
    model = replace(
        like,
        network=made.network,
        config=update(like.config, {"network": _of_weights(made.network)}),
        learned=np.zeros((0, 0), np.float32),
        bundle=None,
    )
    return _remeasured(model, made.notes, threads)


def _remeasured(model: Model, notes: tuple[str, ...], threads: int) -> Imported:
    """``model`` with responses and calibration of its network as it is, which was made or altered elsewhere."""
    said = "responses and calibration are measured again on the references; float weights as learned are not kept"
    return Imported(calibrated(remeasured(model, Pool(threads)), Pool(threads)), (*notes, said))
