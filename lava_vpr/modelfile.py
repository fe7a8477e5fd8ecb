"""The format of a model file: what every key of its header and every array must be, checked in this one place.

A file may be anybody's, so each value is checked by its type, its range and the others. With P places, T
traverses, I inputs (of the settings), N neurons:

    version        text of 1 to 40 printable characters
    config         settings, each of its type and within its range (`lava_vpr.config`)
    stretches      rows of five whole numbers: first place, places, first neuron, neurons, view; each has one place at
                   least and the neurons that the settings make for so many; those of each view, view after view, tile P
                   in order, and all together N, at least 1; one row with preset ``paper``. A sixth number, at least 1,
                   says how many places of the stretch have been removed: it then has at most the neurons that the
                   settings make for these, too. Such stretches are the same in every view; none with preset ``paper``
    place_names    P texts, at least 2, of at most 1,024 characters, without NUL, that UTF-8 can write
    route_images   whole number, at least P
    training       the figures in `FIGURES`, finite, at least 0
    fixed          `FixedNetwork.scalars`, whole numbers as its ``check`` allows; interval, ``bits``, ``signed``,
                   ``regular`` and ``bias_input`` are those of the settings. Not with preset ``paper``, not in a bundle
    frame          the name of a frame (`lava_vpr.positions.frames`); there if and only if the array ``positions`` is

and no other key. The arrays are those of `_rules`, all but ``hog``, ``positions`` and ``calibration``, which may be
missing, and no other: a model of images has patches, one of vectors has these and what they are measured by. Each is of
its type and shape, its least and most value within its range, none of them NaN. Beyond that, positions are within the
range of their frame, place_indices differ from each other and are below route_images, and labels are 0..P-1, T times
over. What a query to it costs is within the limits ``presentation_operations`` and ``presentation_bytes``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import UNSIGNED, Config
from lava_vpr.configfile import of_file
from lava_vpr.engine import effort
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference.fixed import OF_DIRECT, SCALARS, FixedNetwork
from lava_vpr.errors import ConfigError, brief
from lava_vpr.inputs.encoder import INPUTS, EncoderConfig
from lava_vpr.inputs.patches import HOG_VALUES
from lava_vpr.inputs.vectors import LARGEST_VALUE, Standard, width_for
from lava_vpr.loihi import WEIGHT_LIMIT
from lava_vpr.matching.probability import KINDS
from lava_vpr.positions.frames import LAT_LON, MOST_METRES, XY, fits, is_frame
from lava_vpr.settings.conductance import ConductanceLearning, ConductanceNetwork
from lava_vpr.settings.ranges import real, whole
from lava_vpr.storage.arrays import ArrayRule, UnfitError, check_arrays, check_keys
from lava_vpr.storage.limits import excess

FIGURES = ("spikes_per_image", "neurons_used", "places_covered")
"""The figures of the training run."""

LEARNED = ("learned", "responses", "place_indices", "labels", "activity", "thumbnails")
"""The arrays of every model beside those of its network."""

_OPTIONAL = ("hog", "positions", "calibration")
"""Arrays that a model may lack: HOG if it is old or learned from activity alone, positions where nobody gave them, a
calibration if it was not measured."""
_MOST_SAMPLES = 1 << 16

_NAME = re.compile(r"[^\0\ud800-\udfff]{0,1024}")
"""The name of a place; JSON can hold halves of characters, which UTF-8 cannot write."""
_MOST_VERSION, MOST_COUNT = 40, 2**53
_HEADERS = 1 << 16
"""Bytes that are set aside for the settings, and for what each array says of itself."""
_MOST_FLOAT = float(np.finfo(np.float32).max)
STANDARD = "standard."
"""What the names of the arrays begin with that vectors are measured by (`lava_vpr.inputs.vectors.Standard`)."""
_LEAST_SCALE = float(np.finfo(np.float32).tiny)
_HEADER = ("version", "config", "stretches", "place_names", "route_images", "training")


class Sizes(NamedTuple):
    """The numbers that shapes are made of."""

    places: int
    images: int
    inputs: int
    neurons: int


def checked(
    header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], network: FixedNetwork | None = None
) -> tuple[Config, FixedNetwork | ConductanceState]:
    """Settings and network of a file's ``header`` and ``arrays``, all of which are seen to be those of a model.

    Args:
        header, arrays: From the file.
        network: The network, where the file has none.
    Raises:
        UnfitError: something is missing, too much, of another type, or contradicts the rest.
        LavaVprError: settings or network are out of range, or too costly.
    """
    config = _config(header, network)
    names = check_names(header["place_names"])
    stretches = check_stretches(header["stretches"], len(names), config)
    sizes = Sizes(
        len(names), _images(arrays, len(names), len(config.views.views)), config.encoder.inputs, sum(stretches[-1][2:4])
    )
    effort.check_query(config, sizes.neurons)
    own = {} if network is not None else _network_rules(config, sizes)
    check_arrays({name: arrays[name] for name in own if name in arrays}, own)
    found = _network(header, arrays, config) if network is None else network
    if isinstance(found, FixedNetwork):
        found.check()
        _agree(found, config)
        if found.weights.shape != (sizes.inputs, sizes.neurons):
            raise UnfitError(f"references of {sizes.neurons} neurons for a network of shape {found.weights.shape}")
    rules = _rules(config, sizes)
    if "responses" in arrays and arrays["responses"].dtype == np.int32:  # whose counts need it, or of an older file
        rules["responses"] = rules["responses"]._replace(dtype="int32")
    bare = arrays.get("learned", arrays["labels"]).shape == (0, 0)  # a bundle's model, saved
    if network is not None or bare:
        rules["learned"] = rules["learned"]._replace(shape=(0, 0))
    if "calibration" in arrays:
        rules["calibration"] = _calibration_rule(arrays["calibration"], config)
    check_arrays({name: array for name, array in arrays.items() if name not in own}, rules, _OPTIONAL)
    _check_standard(arrays)
    _check_frame(header, arrays)
    _check_places(arrays, sizes, count(header["route_images"], "route_images", sizes.places))
    _check_figures(header["training"])
    return config, found


def check_model(config: Config, places: int, traverses: int, neurons: int) -> None:
    """Refuse, before it is learned, a model whose file would be too large to be read.

    Raises:
        ConfigError: naming its size and the limit.
    """
    sizes = Sizes(places, places * traverses, config.encoder.inputs, neurons)
    if sizes.inputs == 0:
        raise ConfigError(
            f"inputs {config.encoder.kind!r} see vectors, of which nothing is known; give vectors to learn"
        )
    rules = array_rules(config, sizes)
    content = sum(math.prod(rule.shape) * np.dtype(rule.dtype).itemsize for rule in rules.values())
    beyond = excess("model_bytes", content + _HEADERS + 300 * places)  # and their names
    if beyond is not None:
        raise ConfigError(f"a model of {places:,} places and {neurons:,} neurons takes {beyond}, or learn fewer places")


def array_rules(config: Config, sizes: Sizes) -> dict[str, ArrayRule]:
    """What every array of a model file must be."""
    return {**_rules(config, sizes), **_network_rules(config, sizes)}


def _config(header: Mapping[str, Any], network: FixedNetwork | None) -> Config:
    """The settings, once the keys of the header are those of a model."""
    check_keys(header, _HEADER, ("fixed", "frame"), "key {} in its header")
    config = of_file(header["config"])
    if config.encoder.inputs == 0:
        raise UnfitError(f"inputs {config.encoder.kind!r} of vectors without values")
    fixed = ("fixed",) if network is None and not isinstance(config.network, ConductanceNetwork) else ()
    check_keys(header, (*_HEADER, *fixed), ("frame",), "key {} in its header")
    version = header["version"]
    if not isinstance(version, str) or not 0 < len(version) <= _MOST_VERSION or not version.isprintable():
        raise UnfitError(f"version {brief(version)}")
    return config


def _check_frame(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Refuse a frame without positions, or they without it, and positions that are not within its range."""
    if ("frame" in header) != ("positions" in arrays):
        raise UnfitError("positions without a frame, or a frame without positions")
    if "frame" in header and not is_frame(header["frame"]):
        raise UnfitError(f"frame {brief(header['frame'])}, which must be {XY}, {LAT_LON}, or a zone as in UTM 32N")
    if "frame" in header and not fits(arrays["positions"], header["frame"]).all():
        raise UnfitError(f"positions out of the range of their frame, {header['frame']}")


def count(value: object, name: str, least: int, most: int = MOST_COUNT) -> int:
    """``value`` of a file if it is a whole number in ``least`` .. ``most``.

    Raises:
        UnfitError: it is not.
    """
    if not isinstance(value, int) or not whole(value):
        raise UnfitError(f"{name} {brief(value)}, which must be a whole number")
    if not least <= value <= most:
        raise UnfitError(f"{name} {brief(value)}, which must be in {least}..{most}")
    return value


def check_names(value: object, least: int = 2) -> tuple[str, ...]:
    """The names of the places.

    Raises:
        UnfitError: they are none, or less than ``least``.
    """
    if not isinstance(value, list) or len(value) < least:
        raise UnfitError(f"place_names {brief(value)}, which must be the names of two places or more")
    for number, name in enumerate(value):
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise UnfitError(f"the name {brief(name)} of place {number}")
    return tuple(value)


def check_stretches(value: object, places: int, config: Config) -> tuple[tuple[int, ...], ...]:
    """The stretches, in order and without gaps; each row has five numbers, or six where places were removed.

    Raises:
        UnfitError: they are none of so many places.
    """
    if not isinstance(value, list) or not value:
        raise UnfitError(f"stretches {brief(value)}")
    paper = isinstance(config.network, ConductanceNetwork)
    if paper and len(value) > 1:
        raise UnfitError(f"{len(value)} stretches of a conductance model, which learns in one")
    rows: list[tuple[int, ...]] = []
    place = neuron = view = 0
    views = len(config.views.views)
    for row in value:
        if not isinstance(row, list) or len(row) not in ((5,) if paper else (5, 6)):
            raise UnfitError(f"stretch {brief(row)}")
        if place == places and view < views - 1:
            place, view = 0, view + 1
        name = f"stretch {len(rows)} {brief(row)} with"
        first_place, length = count(row[0], name, place, place), count(row[1], name, 1, places - place)
        removed = tuple(count(number, name, 1) for number in row[5:])
        most = config.neurons_for(length + sum(removed))
        first_neuron, neurons = count(row[2], name, neuron, neuron), count(row[3], name, 0 if removed else most, most)
        rows.append((first_place, length, first_neuron, neurons, count(row[4], name, view, view), *removed))
        place, neuron = place + length, neuron + neurons
    if place != places or view != views - 1:
        raise UnfitError(f"stretches of {place} places in view {view} for {places} names and {views} views")
    if neuron == 0:
        raise UnfitError("stretches that have no neuron left")
    cuts = [[(row[0], row[1], *row[5:]) for row in rows if row[4] == view] for view in range(views)]
    if any(cut != cuts[0] for cut in cuts):
        raise UnfitError("stretches that are cut otherwise in another view")
    return tuple(rows)


def _images(arrays: Mapping[str, NDArray[Any]], places: int, views: int) -> int:
    """The number of reference images: one for each place in every view and traverse."""
    if "labels" not in arrays:
        raise UnfitError(brief("labels"))
    shape = arrays["labels"].shape
    if len(shape) != 1 or shape[0] < places or shape[0] % (places * views):
        raise UnfitError(f"labels of shape {shape} for {places} places in {views} views")
    return int(shape[0])


def _check_figures(value: object) -> None:
    """Refuse what are no figures of a training run."""
    if not isinstance(value, dict) or set(value) != set(FIGURES):
        raise UnfitError(f"training {brief(value)}, which must be {', '.join(FIGURES)}")
    for name, figure in value.items():
        if not isinstance(figure, (int, float)) or not real(figure) or not 0 <= figure <= MOST_COUNT:
            raise UnfitError(f"training {name} {brief(figure)}")


def _network(
    header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], config: Config
) -> FixedNetwork | ConductanceState:
    """The network that the file holds, whose arrays are of its type and shape."""
    own = {name.removeprefix("network."): array for name, array in arrays.items() if name.startswith("network.")}
    if isinstance(config.network, ConductanceNetwork):
        return ConductanceState(**own)
    fixed = header["fixed"]
    wanted = (*SCALARS, *(OF_DIRECT if config.encoder.direct else ()))
    if not isinstance(fixed, dict) or set(fixed) != set(wanted):
        raise UnfitError(f"fixed {brief(fixed)}, which must be {', '.join(wanted)}")
    for name, value in fixed.items():
        count(value, name, -MOST_COUNT)
    return replace(FixedNetwork.of_scalars(own["weights"], own["bias"], fixed), model=config.network.model)


def _agree(network: FixedNetwork, config: Config) -> None:
    """Refuse an integer network that is not the one of the settings."""
    settings = config.network
    if isinstance(settings, ConductanceNetwork):
        raise UnfitError("an integer network with the settings of the conductance model")
    before = config.encoder.direct
    for name, own, set_to in (
        ("neurons of the model", network.model, settings.model),
        ("presentations of steps", network.interval, config.steps),
        ("rising from step", network.rising, 0 if before is None else before.rising),
        ("bits", network.bits, settings.weight_bits),
        ("signed", int(network.signed), int(settings.signed)),
        ("regular", int(network.regular), int(settings.trains == "regular")),
        ("bias_input", int(network.bias_input), int(settings.input_mode == "bias")),
    ):
        if own != set_to:
            raise UnfitError(f"{name} {own} where the settings say {set_to}")


def _network_rules(config: Config, sizes: Sizes) -> dict[str, ArrayRule]:
    """What the arrays of the network must be."""
    shape, network, learning = (sizes.inputs, sizes.neurons), config.network, config.learning
    if not isinstance(network, ConductanceNetwork) or not isinstance(learning, ConductanceLearning):
        return {
            "network.weights": ArrayRule("int16", shape, least=-WEIGHT_LIMIT, most=WEIGHT_LIMIT),
            "network.bias": ArrayRule("int32", shape[1:], least=-MOST_COUNT, most=MOST_COUNT),
        }
    largest = max(learning.w_max, learning.weight_sum) * (1 + 1e-9)  # one weight can be all that is normalised
    longest = math.floor(network.delay_max_ms / network.dt_ms + 0.5)
    return {
        "network.weights": ArrayRule("float64", shape, most=largest),
        "network.theta_mv": ArrayRule("float64", shape[1:], most=MOST_COUNT),
        "network.delays": ArrayRule("uint16", shape, most=longest),
    }


def _rules(config: Config, sizes: Sizes) -> dict[str, ArrayRule]:
    """What the arrays beside the network's must be; ``learned`` may also be empty."""
    places, images, inputs, neurons = sizes
    network, learning = config.network, config.learning
    learned = (0, 0) if isinstance(learning, ConductanceLearning) else (inputs, neurons)
    repeats = min(learning.label_epochs, learning.epochs) if isinstance(learning, ConductanceLearning) else 1
    most = images // places * repeats * network.steps
    return {
        "learned": ArrayRule(
            "float32",
            learned,
            least=-_MOST_FLOAT if learned[1] and learning.rule not in UNSIGNED else 0,
            most=_MOST_FLOAT,
        ),
        "responses": ArrayRule("uint16" if most < 2**16 else "int32", (neurons, places), most=most),
        "place_indices": ArrayRule("int64", (places,), most=MOST_COUNT),
        "labels": ArrayRule("int64", (images,), most=places - 1),
        "activity": ArrayRule(
            "float32",
            (images, inputs),
            most=255 if INPUTS[config.encoder.kind].grey_levels else _MOST_FLOAT,
        ),
        "thumbnails": ArrayRule("uint8", (places, 48, 64, 3), most=255),
        "positions": ArrayRule("float64", (places, 2), least=-MOST_METRES, most=MOST_METRES),
        "calibration": ArrayRule("float32", (_MOST_SAMPLES, 2), least=-1.0, most=_MOST_FLOAT),
        **_seen_rules(config.encoder, images),
    }


def _seen_rules(encoder: EncoderConfig, images: int) -> dict[str, ArrayRule]:
    """What the arrays must be that are of images alone, or of vectors alone."""
    row, values = INPUTS[encoder.kind], encoder.vector_values
    if row.sees != "vector":
        return {
            "patches": ArrayRule("uint8", (images, 28, 28), most=255),
            "hog": ArrayRule("uint8", (images, HOG_VALUES), most=255),
        }
    rules = {"vectors": ArrayRule("float32", (images, values), least=-LARGEST_VALUE, most=LARGEST_VALUE)}
    if row.standardised:
        projects = values > encoder.vector_kept
        width, kept = (width_for(values), encoder.vector_kept) if projects else (0, 0)
        rules |= {
            f"{STANDARD}mean": ArrayRule("float32", (values,), least=-LARGEST_VALUE, most=LARGEST_VALUE),
            f"{STANDARD}scale": ArrayRule("float32", (values,), least=_LEAST_SCALE, most=LARGEST_VALUE),
            f"{STANDARD}signs": ArrayRule("int8", (width,), least=-1, most=1),
            f"{STANDARD}kept": ArrayRule("int32", (kept,), most=max(0, width - 1)),
        }
    return rules


def standard_of(arrays: Mapping[str, NDArray[Any]]) -> Standard | None:
    """What vectors are measured by, if the ``arrays`` of a model file hold it."""
    own = {name: array for name, array in arrays.items() if name.startswith(STANDARD)}
    return Standard(**{name.removeprefix(STANDARD): array for name, array in own.items()}) if own else None


def _check_standard(arrays: Mapping[str, NDArray[Any]]) -> None:
    """Refuse signs that are none, and numbers of a transform that are not ascending.

    Raises:
        UnfitError: there are such.
    """
    standard = standard_of(arrays)
    if standard is not None and ((standard.signs == 0).any() or (np.diff(standard.kept) <= 0).any()):
        raise UnfitError("a projection with a sign of 0, or with numbers that do not ascend")


def _calibration_rule(samples: NDArray[Any], config: Config) -> ArrayRule:
    """What the samples of a calibration must be: some, not too many, of an integer network, each of a known kind."""
    if isinstance(config.network, ConductanceNetwork):
        raise UnfitError("a calibration of the conductance model, which has none")
    if samples.ndim != 2 or not 0 < len(samples) <= _MOST_SAMPLES or samples.shape[1] != 2:
        raise UnfitError(f"a calibration of shape {samples.shape}, which must be some rows of a margin and a kind")
    if not np.isin(samples[:, 1], KINDS).all() or not (samples[:, 0] >= 0).all():
        raise UnfitError(
            "a calibration with a negative margin, or of a sample that is neither right, wrong nor off the map"
        )
    return ArrayRule("float32", samples.shape, least=-1.0, most=_MOST_FLOAT)


def _check_places(arrays: Mapping[str, NDArray[Any]], sizes: Sizes, route_images: int) -> None:
    """Refuse places that share an index or lie beyond the route, and labels that are not traverse after traverse."""
    indices = arrays["place_indices"]
    if len(np.unique(indices)) != sizes.places:
        raise UnfitError("place_indices of which two are equal")
    if indices.max() >= route_images:
        raise UnfitError(f"place_indices up to {indices.max()} in a route of {route_images} images")
    if not np.array_equal(arrays["labels"], np.tile(np.arange(sizes.places), sizes.images // sizes.places)):
        raise UnfitError("labels that are not the places, traverse after traverse")
