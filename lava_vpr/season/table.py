"""What a drive's queries were presented with, gains and biases, as a file (``.lvpg``) that every backend replays.

Answers that teach decide what later queries are shown with, so what counts the spikes of a batch cannot know it. The
host answers first and writes down what it used; whoever replays that learns nothing again, and counts the same spikes.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr import __version__
from lava_vpr.configfile import to_dict
from lava_vpr.engine.gains import FULL
from lava_vpr.engine.presentations import check_array
from lava_vpr.errors import ConfigError, InputError, LavaVprError, ModelFileError, said, shown as told
from lava_vpr.model import IntegerModel
from lava_vpr.storage import container
from lava_vpr.storage.arrays import ArrayRule, UnfitError, check_arrays, check_keys

_KIND = "gain table"
_HASHES = ("network_of", "map_of")
_HASH = re.compile("[0-9a-f]{64}")
_BIASES = np.iinfo(np.int32)


class Used(NamedTuple):
    """What some queries of a drive were presented with.

    Attributes:
        gains: Those in force, uint8 (inputs,).
        bias: Biases, int32 (n, neurons).
        images: Image keys, uint64 (n,).
    """

    gains: NDArray[np.uint8]
    bias: NDArray[np.int32]
    images: NDArray[np.uint64]


@dataclass(frozen=True, eq=False)
class GainTable:
    """What the queries of a drive were presented with, in order.

    Attributes:
        gains: The gains of each epoch, uint8 (epochs, inputs), at most `FULL`.
        epoch: The epoch of each query, int32 (n,).
        bias: Its biases, int32 (n, neurons).
        images: Its image key, uint64 (n,): another image is none of the drive's.
        network_of: Which network and inputs these are: a hash.
        map_of: Which map, whatever the numbers of its network: a hash.
        name: The file, for messages.
    """

    gains: NDArray[np.uint8] = field(repr=False)
    epoch: NDArray[np.int32] = field(repr=False)
    bias: NDArray[np.int32] = field(repr=False)
    images: NDArray[np.uint64] = field(repr=False)
    network_of: str = ""
    map_of: str = ""
    name: str = "the gain table"

    @classmethod
    def of(cls, model: IntegerModel, parts: Iterable[Used]) -> GainTable:
        """The table of a drive's ``parts``, at least one, in order; an epoch begins where gains change."""
        some = list(parts)
        begins = [k == 0 or not np.array_equal(part.gains, some[k - 1].gains) for k, part in enumerate(some)]
        numbers = np.cumsum(begins) - 1
        return cls(
            np.stack([part.gains for part, begin in zip(some, begins, strict=True) if begin]),
            np.repeat(numbers, [len(part.images) for part in some]).astype(np.int32),
            np.concatenate([part.bias for part in some]),
            np.concatenate([part.images for part in some]),
            network_of(model),
            map_of(model),
        )

    def check(self, model: IntegerModel) -> None:
        """Refuse to replay to ``model`` what another network was presented with, or what none can be.

        Raises:
            ConfigError: it is another, or its biases fit no registers.
        """
        if self.network_of != network_of(model):
            if self.map_of == map_of(model):
                raise ConfigError(
                    f"{self.name}: was written with another network of the same map (deploy changes bits, pruning and "
                    "inhibition); write it again with this model, or with the bundle that deploy makes without "
                    "--replay: query --learn --gains"
                )
            raise ConfigError(
                f"{self.name}: was written with another model (other weights or inputs); give that model, or write it "
                "again with --learn --gains"
            )
        try:
            check_array(self.gains, "gains", np.uint8, (len(self.gains), model.network.inputs), "write it again")
            model.network.check_presented(self.bias, len(self.epoch))
        except LavaVprError as error:
            raise ConfigError(f"{self.name}: does not hold what its model takes ({said(error)})") from None

    def check_length(self, queries: int) -> None:
        """Refuse to replay to more ``queries`` than there are.

        Raises:
            InputError: there are fewer.
        """
        if queries > len(self.images):
            raise InputError(
                f"{self.name}: has {len(self.images):,} queries, but {queries:,} are asked; give no more, or write it "
                "again with --learn --gains"
            )


def inputs_of(model: IntegerModel) -> str:
    """A hash of all that decides which inputs a model has, and their rates."""
    made = hashlib.sha256(json.dumps(to_dict(model.config)["encoder"], sort_keys=True).encode())
    if model.standard is not None:
        for name, array in sorted(model.standard.arrays.items()):
            made.update(name.encode() + array.tobytes())
    return made.hexdigest()


def network_of(model: IntegerModel) -> str:
    """A hash of all that decides which neurons and inputs a model has; not where inputs stand, which a board's folder
    may decide otherwise."""
    network = model.network
    scalars = {name: value for name, value in network.scalars.items() if name != "bias_input"}
    made = hashlib.sha256(json.dumps([inputs_of(model), network.weights.shape, scalars]).encode())
    made.update(network.weights.tobytes() + network.bias.tobytes())
    return made.hexdigest()


def map_of(model: IntegerModel) -> str:
    """A hash of all that decides what a model has learned, which stays when its network is quantised otherwise."""
    settings = {name: values for name, values in to_dict(model.config).items() if name != "network"}
    stretches = [stretch.row for stretch in model.stretches]
    made = hashlib.sha256(json.dumps([inputs_of(model), settings, stretches], sort_keys=True).encode())
    made.update(model.activity.tobytes())
    return made.hexdigest()


def save(table: GainTable, path: Path) -> None:
    """Write ``table`` to ``path``; the file appears complete or not at all.

    Raises:
        ModelFileError: it cannot be written; what stood at ``path`` still does.
    """
    container.save(path, _KIND, *_content(table))


def packed(table: GainTable) -> bytes:
    """The bytes of the file of ``table``."""
    return container.pack(_KIND, *_content(table))


def load(path: Path | str) -> GainTable:
    """The table in the file at ``path``.

    Raises:
        ModelFileError: missing, foreign, damaged, or inconsistent.
    """
    return _table(*container.load(Path(path), _KIND), told(Path(path)))


def unpacked(data: bytes, path: Path) -> GainTable:
    """The table in ``data``, bytes of a file; ``path`` is for messages.

    Raises:
        ModelFileError: foreign, damaged, or inconsistent.
    """
    return _table(*container.unpack(data, path, _KIND), told(path))


def _content(table: GainTable) -> tuple[dict[str, object], dict[str, NDArray[Any]]]:
    """Header and arrays of the file of ``table``."""
    arrays = {name: getattr(table, name) for name in ("gains", "epoch", "bias", "images")}
    return {"version": __version__, **{name: getattr(table, name) for name in _HASHES}}, arrays


def _table(header: dict[str, Any], arrays: dict[str, NDArray[Any]], name: str) -> GainTable:
    """The table that a file called ``name`` has.

    Raises:
        ModelFileError: it is inconsistent.
    """
    try:
        check_keys(header, ("version", *_HASHES), (), "key {} in its header")
        for known in _HASHES:
            if not (isinstance(header[known], str) and _HASH.fullmatch(header[known])):
                raise UnfitError(known)
        epochs, inputs = _sizes(arrays, "gains")
        queries, neurons = _sizes(arrays, "bias")
        rules = {
            "gains": ArrayRule("uint8", (epochs, inputs), 0, FULL),
            "epoch": ArrayRule("int32", (queries,), 0, epochs - 1),
            "bias": ArrayRule("int32", (queries, neurons), _BIASES.min, _BIASES.max),
            "images": ArrayRule("uint64", (queries,)),
        }
        check_arrays(arrays, rules)
    except UnfitError as error:
        remedy = container.REMEDIES[_KIND]
        raise ModelFileError(f"{name}: the {_KIND} {error.how} {error}; {remedy}") from None
    values: dict[str, Any] = {key: np.asarray(array) for key, array in arrays.items()}
    return GainTable(**values, **{known: header[known] for known in _HASHES}, name=name)


def _sizes(arrays: dict[str, NDArray[Any]], name: str) -> tuple[int, int]:
    """Rows and columns of the array called ``name``.

    Raises:
        UnfitError: there is none, or it has others.
    """
    array = arrays.get(name)
    if array is None or array.ndim != 2:
        raise UnfitError(name)
    return array.shape[0], array.shape[1]
