"""The model that a network from another program's file makes: with the references in the file, or those of a model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import integer_config
from lava_vpr.configfile import from_dict, to_dict, update
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import InputError, LavaVprError, ModelFileError, shown
from lava_vpr.exchange.drawn import Drawn, digest, whole
from lava_vpr.exchange.formats import TIME_STEP, FormatRow
from lava_vpr.model import IntegerModel, Model, assemble, integer_model
from lava_vpr.storage import container
from lava_vpr.training.measuring import calibrated, remeasured


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
        ConfigError: ``like`` has the conductance model.
        LavaVprError: the network is out of the range of the chip's registers.
    """
    source = None if like is None else integer_model(like, "a network in another format")
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
    made = whole(drawn, integer_config(from_dict(header.get("config")), "a network in another format").network)
    learned = arrays.get("learned", np.zeros((0, 0), np.float32))
    shape = (made.network.inputs, made.network.neurons)
    if learned.size and (learned.dtype != np.float32 or learned.shape != shape or not np.isfinite(learned).all()):
        raise ModelFileError(f"{shown(path)}: the float weights in it are no array {shape}; export the model again")
    kept = {**arrays, "learned": np.zeros((0, 0), np.float32)}
    unaltered = digest(made.network) == drawn.digest
    if unaltered:
        model = replace(assemble(path, header, kept, made.network), learned=learned)
        return Imported(model, made.notes)
    config = update(from_dict(header["config"]), {"network": _of_weights(made.network)})
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
    said = "responses and calibration are measured anew on the references; float weights as learned are not kept"
    return Imported(calibrated(remeasured(model, Pool(threads)), Pool(threads)), (*notes, said))
