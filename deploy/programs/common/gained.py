"""Queries under the gains of the bundle's table: rates, keys and biases as lava_vpr.backends.replaying has them."""

import io
import zlib
from typing import Dict

import numpy as np

from bundle_files import Bundle, bad
from input_draws import GOLDEN, mixed
from refusals import Refused

TABLE, FACTS, FULL = "host/gains.lvpg", "gains", 15
CHUNK = 8192  # values that are added up before the next ones
BIAS_BITS = 12


def table_of(bundle: Bundle) -> Dict[str, np.ndarray]:
    """The arrays of the bundle's table, by name: gains, epoch, bias, images.

    Raises:
        Refused: there is none, or it is of another network.
    """
    if TABLE not in bundle.files:
        remedy = "write rates.npy and keys.npy, or deploy the model with --replay"
        raise Refused("input", "activity.npy needs gains, which this bundle has none of; " + remedy)
    inputs, neurons = bundle.numbers("inputs", "neurons")
    try:
        data = bundle.files[TABLE].split(b"\n", 2)[2]  # a line of its kind, and one of its checksum
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            table = {name: arrays["a." + name] for name in ("gains", "epoch", "bias", "images")}
        (epochs, wide), n = table["gains"].shape, len(table["images"])
        fits = wide == inputs and table["bias"].shape == (n, neurons) and table["epoch"].shape == (n,)
        fits = fits and (n == 0 or 0 <= table["epoch"].min() <= table["epoch"].max() < epochs)
    except Exception:  # numpy and zipfile raise all sorts
        fits = False
    if not fits:
        raise bad(bundle.folder, TABLE, "is no table of gains of this network")
    return table


def rates_of(activity: np.ndarray, count: int, spikes: float) -> np.ndarray:
    """Rates uint16 (n, inputs) of activity float32 (n, inputs), as lava_vpr.engine.rates.rates16 defines them."""
    rates = np.zeros(activity.shape, np.uint16)
    for i, own in enumerate(activity):
        least = np.partition(own, -count)[-count] if 0 < count < len(own) else np.float32(0)
        values = np.where(own >= least, own, np.float32(0)).astype(np.float64)
        total = 0.0
        for begin in range(0, len(values), CHUNK):
            total += values[begin : begin + CHUNK].sum()
        if total > 0:
            rates[i] = np.minimum(np.rint(values / total * (spikes * 65536.0)), 65535.0)
    return rates


def image_keys(rates: np.ndarray) -> np.ndarray:
    """Keys of images, uint64 (n,), as lava_vpr.engine.random defines them."""
    with np.errstate(over="ignore"):
        inputs = np.arange(rates.shape[1], dtype=np.uint64) << np.uint64(32)
        words = mixed((inputs + rates.astype(np.uint64)) * GOLDEN)
        return np.where(rates > 0, words, np.uint64(0)).sum(axis=1, dtype=np.uint64)


def query_keys(seed: int, images: np.ndarray) -> np.ndarray:
    """Keys of presentations of queries, uint64 (n,), as lava_vpr.engine.random defines them."""
    with np.errstate(over="ignore"):
        key = mixed(np.array([seed], np.uint64) + GOLDEN)
        for word in (zlib.crc32(b"query"), 0):
            key = mixed((key ^ np.uint64(word)) + GOLDEN)
        return mixed((key ^ images) + GOLDEN)


def registers_of(bias: np.ndarray) -> tuple:
    """Mantissas int32 (n, neurons) and exponents int32 (n,) that hold biases int32 (n, neurons)."""
    values = bias.astype(np.int64)
    sizes = np.abs(values)
    exponents = np.maximum(np.frexp(sizes.max(axis=1).astype(np.float64))[1] - BIAS_BITS, 0).astype(np.int32)
    return (np.sign(values) * (sizes >> exponents[:, None])).astype(np.int32), exponents


def under_gains(bundle: Bundle, activity: np.ndarray, where: str) -> Dict[str, np.ndarray]:
    """What queries with this activity, those of the bundle's table from its first on, are presented with.

    Args:
        bundle: The bundle.
        activity: What the encoding made of the images, float32 (n, inputs).
        where: The folder of the queries, for messages.
    Returns:
        Rates uint16 (n, inputs), keys uint64 (n,), biases int32 (n, neurons), exponents int32 (n,).
    Raises:
        Refused: they are others, or there is no table.
    """
    table, (inputs,) = table_of(bundle), bundle.numbers("inputs")
    if activity.dtype != np.float32 or activity.ndim != 2 or activity.shape[1] != inputs:
        found = f"{activity.dtype} {activity.shape}"
        raise Refused("input", f"{where}: activity.npy is {found}, but must be float32 (n, {inputs})")
    if not (np.isfinite(activity) & (activity >= 0)).all():
        raise Refused("input", f"{where}: activity.npy holds a value below 0, or none; write what the encoding made")
    n, known = len(activity), len(table["images"])
    if n > known:
        raise Refused(
            "input", f"{where}: activity.npy has {n} queries, but the bundle's table has {known}; ask no more"
        )
    try:
        facts = bundle.manifest[FACTS]
        count, spikes, seed = int(facts["query_inputs"]), float(facts["query_spikes"]), int(facts["seed"])
    except (KeyError, TypeError, ValueError):
        raise bad(bundle.folder, "manifest.json", "does not say what its table of gains needs") from None
    plain = rates_of(activity, count, spikes)
    images = image_keys(plain)
    other = np.flatnonzero(images != table["images"][:n])
    if len(other):
        said = f"{where}: query {other[0]} is another image than the bundle's table has there"
        raise Refused("input", said + "; give the images of its drive in order, from the first")
    gains = table["gains"][table["epoch"][:n]]
    lessened = (gains < FULL).any(axis=1)
    plain[lessened] = rates_of(activity[lessened] * gains[lessened].astype(np.float32), count, spikes)
    biases, exponents = registers_of(table["bias"][:n])
    return {"rates": plain, "keys": query_keys(seed, images), "biases": biases, "exponents": exponents}
