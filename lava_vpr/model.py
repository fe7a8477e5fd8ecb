"""A trained model, and its file (``.lvpr``)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from lava_vpr import __version__
from lava_vpr.config import Config, IntegerConfig, as_integer_config
from lava_vpr.configfile import to_dict
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ConfigError, LavaVprError, ModelFileError, shown
from lava_vpr.inputs.vectors import Standard
from lava_vpr.matching import decoders
from lava_vpr.matching.equations import assign
from lava_vpr.modelfile import LEARNED, STANDARD, checked, standard_of
from lava_vpr.neurons.models import CONDUCTANCE, NEURONS, NeuronModel
from lava_vpr.positions.frames import Positions
from lava_vpr.storage import container
from lava_vpr.storage.arrays import UnfitError, narrow


@dataclass(frozen=True)
class Stretch:
    """Part of a route in one view, learned by neurons of its own; ``places`` and ``neurons`` count from ``first_*``.

    ``removed`` is the number of places that were learned with these and have been removed since.
    """

    first_place: int
    places: int
    first_neuron: int
    neurons: int
    view: int = 0
    removed: int = 0

    @property
    def row(self) -> list[int]:
        """The numbers that a file keeps; the last only if places were removed."""
        numbers = list(dataclasses.astuple(self))
        return numbers if self.removed else numbers[:-1]


@dataclass(frozen=True)
class Model:
    """Everything that answers a query, and what baselines and reports need of the references.

    Attributes:
        config: Settings that it was trained with.
        network: What runs: integers for preset ``loihi``, the conductance model's state for ``paper``.
        learned: Float weights as STDP left them, float32 (inputs, neurons); to quantise again. Empty for ``paper``.
        responses: S^R, spikes of each neuron for each place, uint16, or int32 where one is beyond (neurons, places).
        stretches: Parts of the route, in order.
        place_indices: Absolute index of each place in its traverse, int64 (places,).
        place_names: File name of each place's image in the first traverse.
        route_images: Images in the whole first traverse, of which the places may be a part.
        labels: Place of each reference image, int64 (images,): one image per place, view and traverse, traverse after
            traverse, of each view after view.
        patches: Patch-normalised reference images, uint8 (images, 28, 28); None of vectors.
        activity: Input responses to the reference images, float32 (images, inputs).
        thumbnails: First traverse's images, small, uint8 (places, 48, 64, 3) BGR.
        training: Figures of the training run: spikes per image, neurons used, places covered.
        hog: HOG descriptors of the reference images, uint8 (images, 1764); None where a model was learned without them,
            as all were before there was this baseline.
        positions: Where the first traverse's images were taken, float64 (places, 2), in ``frame``; None if unknown.
        frame: The frame of ``positions`` (`lava_vpr.positions.frames`); None without them.
        calibration: Margins of references, right, wrong and off the map, float32 (k, 2)
            (`lava_vpr.matching.probability.Calibration`); None where they were not measured.
        vectors: Reference vectors as they were given, float32 (images, values); None of images.
        standard: What vectors are measured by; None of images, and of vectors that are taken as they are.
        bundle: Folder of the deployed bundle that it was read from; None for a model file.
    """

    config: Config
    network: FixedNetwork | ConductanceState
    learned: NDArray[np.float32]
    responses: NDArray[Any]
    stretches: tuple[Stretch, ...]
    place_indices: NDArray[np.int64]
    place_names: tuple[str, ...]
    route_images: int
    labels: NDArray[np.int64]
    patches: NDArray[np.uint8] | None
    activity: NDArray[np.float32]
    thumbnails: NDArray[np.uint8]
    training: dict[str, float]
    hog: NDArray[np.uint8] | None = None
    positions: NDArray[np.float64] | None = None
    frame: str | None = None
    calibration: NDArray[np.float32] | None = None
    vectors: NDArray[np.float32] | None = None
    standard: Standard | None = None
    bundle: Path | None = None

    @property
    def places(self) -> int:
        """The number of places that the model knows."""
        return len(self.place_names)

    @property
    def neurons(self) -> int:
        """The number of excitatory neurons, all stretches together."""
        return int(self.responses.shape[0])

    @property
    def neuron_model(self) -> NeuronModel:
        """The row of its neurons."""
        return NEURONS[self.network.model] if isinstance(self.network, FixedNetwork) else CONDUCTANCE

    @property
    def weight_bits(self) -> int | None:
        """Bits of a weight; None for the float model."""
        return self.network.bits if isinstance(self.network, FixedNetwork) else None

    @property
    def whereabouts(self) -> Positions | None:
        """``positions`` in their frame."""
        return None if self.positions is None or self.frame is None else Positions(self.positions, self.frame)

    def neuron_places(self) -> NDArray[np.int64]:
        """Place to which each neuron responds most, int64 (neurons,); -1 for a neuron silent on all references."""
        return assign(self.responses)


class IntegerModel(Model):
    """A model whose network is one of integers, as `integer_model` returns it.

    Only type checkers see this class: an accepted value keeps its type `Model`.
    """

    config: IntegerConfig
    network: FixedNetwork


def as_integer(model: Model) -> IntegerModel | None:
    """``model`` itself if its network is one of integers, else None."""
    integer = isinstance(model.network, FixedNetwork) and as_integer_config(model.config) is not None
    return cast(IntegerModel, model) if integer else None


def integer_model(model: Model, purpose: str, path: Path | None = None) -> IntegerModel:
    """``model`` itself, seen to have an integer network.

    Args:
        model: The model.
        purpose: What needs an integer network; the message begins with it.
        path: The file of the model, if it is known.
    Raises:
        ConfigError: the model is the float conductance model.
    """
    integer = as_integer(model)
    if integer is None:
        raise CONDUCTANCE.refusal(purpose, path)
    return integer


def lif_model(model: Model, purpose: str, path: Path | None = None, *, direct: bool = False) -> IntegerModel:
    """As `integer_model`, for what takes LIF neurons alone: boards and formats of other programs.

    Args:
        model, purpose, path: As there.
        direct: Whether neurons may hear the cells of a front end themselves.
    Raises:
        ConfigError: the model is the float conductance model, or one of other neurons or inputs.
    """
    integer = integer_model(model, purpose, path)
    integer.neuron_model.check(purpose, path)
    if integer.network.direct and not direct:
        where = "" if path is None else f"{path}: "
        raise ConfigError(
            f"{where}{purpose} takes inputs that have rates, but these neurons hear the cells of the front end "
            "themselves; train with --input frontend"
        )
    return integer


def checked_network(model: Model, purpose: str, *, direct: bool = False) -> FixedNetwork:
    """The integer network of ``model``, seen not to overflow Loihi's registers.

    Raises:
        ConfigError: the model is the float conductance model, or ``purpose``, a backend, lacks its neurons.
        NetworkLimitError: the network could overflow.
    """
    network = lif_model(model, purpose, direct=direct).network
    network.check()
    return network


def decode(model: Model, counts: NDArray[np.int32], name: str) -> NDArray[np.float64]:
    """Scores float64 (n, places) of spike counts (n, neurons) by the decoder ``name``."""
    return decoders.decode(name, model.responses, counts, gamma=model.config.decoder.gamma)


def prepare(model: Model) -> Callable[[NDArray[np.int32]], NDArray[np.float64]]:
    """The model's own decoder for query after query: from spike counts (n, neurons) to scores (n, places)."""
    decoder = model.config.decoder
    return decoders.prepare(decoder.default, model.responses, gamma=decoder.gamma)


def content(model: Model, network: bool = True) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What a file keeps of ``model``, for `lava_vpr.storage.container`; see `checked_content`.

    Args:
        model: The model.
        network: The network and what it was learned from, too; without it `assemble` is given one.
    """
    arrays: dict[str, NDArray[Any]] = {name: getattr(model, name) for name in LEARNED}
    header: dict[str, Any] = {
        "version": __version__,
        "config": to_dict(model.config),
        "stretches": [stretch.row for stretch in model.stretches],
        "place_names": list(model.place_names),
        "route_images": model.route_images,
        "training": model.training,
    }
    optional = {name: getattr(model, name) for name in ("patches", "hog", "vectors", "calibration")}
    arrays.update({name: array for name, array in optional.items() if array is not None})
    if model.standard is not None:
        arrays.update({f"{STANDARD}{name}": array for name, array in model.standard.arrays.items()})
    if model.positions is not None:
        arrays["positions"] = model.positions
        header["frame"] = model.frame
    if not network:
        arrays["learned"] = np.zeros((0, 0), np.float32)
    elif isinstance(model.network, FixedNetwork):
        header["fixed"] = model.network.scalars
        arrays["network.weights"] = model.network.weights
        arrays["network.bias"] = model.network.bias
    else:
        for field in dataclasses.fields(model.network):
            arrays[f"network.{field.name}"] = getattr(model.network, field.name)
    return header, arrays


def checked_content(model: Model, network: bool = True) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """`content` that `assemble` takes.

    Raises:
        ModelFileError: it would refuse it.
    """
    header, arrays = content(model, network)
    known = model.network if not network and isinstance(model.network, FixedNetwork) else None
    try:
        checked(header, arrays, known)
    except (LavaVprError, UnfitError) as error:
        raise ModelFileError(
            f"the model cannot be kept, no file of it could be read again ({error}); correct what it was made of"
        ) from None
    return header, arrays


def save(model: Model, path: Path) -> None:
    """Write ``model`` to ``path``; the file appears complete or not at all.

    Raises:
        ModelFileError: it cannot be written, or `load` would refuse it; what stood at ``path`` still does.
    """
    try:
        header, arrays = checked_content(model)
    except ModelFileError as error:
        raise ModelFileError(f"{shown(path)}: {error}") from None
    container.save(path, "model", header, arrays)


def load(path: Path | str) -> Model:
    """The model in the file at ``path``.

    Raises:
        ModelFileError: missing, foreign, damaged, or inconsistent.
    """
    path = Path(path)
    return assemble(path, *container.load(path, "model"))


def assemble(
    path: Path, header: dict[str, Any], arrays: dict[str, NDArray[Any]], network: FixedNetwork | None = None
) -> Model:
    """The model of what `content` kept.

    Args:
        path: For messages.
        header, arrays: From the file.
        network: The network, where the file has none.
    Raises:
        ModelFileError: parts are missing, out of range, or do not fit each other (`lava_vpr.modelfile`).
    """
    remedy = container.REMEDIES["model" if network is None else "references"]
    try:
        config, known = checked(header, arrays, network)
    except LavaVprError as error:
        raise ModelFileError(f"{shown(path)}: the model cannot be used ({error}); {remedy}") from None
    except UnfitError as error:
        raise ModelFileError(f"{shown(path)}: the model {error.how} {error}; {remedy}") from None
    return Model(
        config=config,
        network=known,
        stretches=tuple(Stretch(*row) for row in header["stretches"]),
        place_names=tuple(header["place_names"]),
        route_images=header["route_images"],
        training=header["training"],
        learned=arrays["learned"],
        responses=narrow(arrays["responses"]),
        place_indices=arrays["place_indices"],
        labels=arrays["labels"],
        patches=arrays.get("patches"),
        activity=arrays["activity"],
        thumbnails=arrays["thumbnails"],
        hog=arrays.get("hog"),
        positions=arrays.get("positions"),
        frame=header.get("frame"),
        calibration=arrays.get("calibration"),
        vectors=arrays.get("vectors"),
        standard=standard_of(arrays),
    )
