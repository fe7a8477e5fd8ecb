"""The gain table in a bundle: what a drive's queries are presented with, for its host program and for backends.

The file is that of ``--gains``, so that ``--replay`` takes it from the folder as it is. What the program needs of the
settings besides stands in the manifest.
"""

from __future__ import annotations

from typing import Any

from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, ReadBundle
from lava_vpr.errors import BundleError, ConfigError
from lava_vpr.model import Model, integer_model
from lava_vpr.season.table import GainTable, packed, unpacked

TABLE, FACTS = "host/gains.lvpg", "gains"
"""The table's file in the bundle, and the manifest's key of what belongs to it."""


def gain_files(table: GainTable, model: Model) -> dict[str, bytes]:
    """The file of ``table`` by its name in the bundle of ``model``.

    Raises:
        ConfigError: it is of another network.
        ModelFileError: it unpacks to more than the limits allow.
    """
    table.check(integer_model(model, "--replay"))
    return {TABLE: packed(table)}


def facts(table: GainTable, model: Model) -> dict[str, Any]:
    """What the manifest says of ``table``: its size, and what decides the rates and noise of queries."""
    encoder = model.config.encoder
    return {
        "queries": len(table.images),
        "epochs": len(table.gains),
        "query_inputs": encoder.query_inputs,
        "query_spikes": float(encoder.query_spikes),
        "seed": model.config.seed,
    }


def check_gains(bundle: ReadBundle, model: Model) -> None:
    """Refuse a gain table that does not belong to ``model``, the bundle's, or that contradicts the manifest.

    Raises:
        ModelFileError: the file is no table.
        BundleError: it is of another network, or the manifest contradicts it.
    """
    said, known = bundle.manifest.get(FACTS), None
    if TABLE in bundle.files:
        table = unpacked(bundle.data(TABLE), bundle.path / TABLE)
        known = facts(table, model)
        try:
            table.check(integer_model(model, "--replay"))
        except ConfigError as error:
            raise BundleError(str(error)) from None
    if said != known:
        raise BundleError(f"{bundle.at(MANIFEST)}: what it says of gains is not what {TABLE} has; {AGAIN}")
