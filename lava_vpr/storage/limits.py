"""The limits on what a file may cost: named, each with its reason, and raised by an environment variable of its name.

A limit is checked before its cost is paid: before memory is taken, a step simulated, a picture decoded. The variable of
the limit ``image_pixels`` is LAVA_VPR_MAX_IMAGE_PIXELS, a whole number. docs/security.md lists all limits.
"""

from __future__ import annotations

import difflib
import logging
import os
from dataclasses import dataclass

from lava_vpr.errors import ConfigError, InputError, brief

MIB, GIB = 1 << 20, 1 << 30
_UNSUSPICIOUS = 64 * MIB
"""Bytes that a file may unpack to however small it is."""


@dataclass(frozen=True)
class Limit:
    """One limit.

    Attributes:
        default: The most that is accepted unless the variable says otherwise.
        unit: What is counted, in the plural.
        reason: Why so much suffices, and why not more.
    """

    default: int
    unit: str
    reason: str


LIMITS: dict[str, Limit] = {
    "text_bytes": Limit(64 * MIB, "bytes", "a list of a million images with paths of 64 characters"),
    "rows": Limit(2_000_000, "lines", "23 days of an image a second; read as a table they take up to 1 GB of memory"),
    "points": Limit(250_000, "points", "69 hours of a point a second; read as GPX they take half a GB of memory"),
    "config_bytes": Limit(64 << 10, "bytes", "thirty times all settings of a preset"),
    "array_bytes": Limit(
        4 * GIB, "bytes", "descriptors of a quarter of a million images, 4,096 numbers of 4 bytes each, as NetVLAD has"
    ),
    "image_bytes": Limit(GIB, "bytes", "more than the largest accepted picture takes without compression"),
    "image_pixels": Limit(
        178_956_970, "pixels", "where Pillow, too, refuses a picture as a decompression bomb (twice MAX_IMAGE_PIXELS)"
    ),
    "model_file_bytes": Limit(GIB, "bytes", "twice what a model of 20,000 places takes on the disk"),
    "model_bytes": Limit(
        2_440_000_000,
        "bytes",
        "a model of the 27,592 places that Nordland has in the field's protocols, with a neuron each; its reference "
        "responses take 1.5e9 bytes",
    ),
    "unpacked_times": Limit(
        100,
        "times its size",
        "500 real places unpack to twice their size, 20,000, whose responses are nearly all 0, to some ten "
        "times; what unpacks to less than 64 MiB is not held to it",
    ),
    "header_bytes": Limit(
        8 * MIB, "bytes", "names of 255 characters for 20,000 places, with room; its objects take 250 MB"
    ),
    "bundle_bytes": Limit(2 * GIB, "bytes", "20,000 places: their responses take 1.6 GB, all else less than 0.2 GB"),
    "bundle_files": Limit(10_000, "files", "a full Kapoho Bay has 1,280 files of cores; a learned stretch has five"),
    "bundle_json_bytes": Limit(
        4 * MIB, "bytes", "10,000 files take 2 MB of manifest; once read, it takes 30 times more"
    ),
    "image_parts": Limit(
        200_000, "parts", "1 GiB in chunks of 8 kB, the size in which libpng writes them, has 131,072"
    ),
    "jpeg_scans": Limit(
        100, "scans", "a progressive JPEG has about ten; each takes the time of a picture, however short"
    ),
    "simulation_bytes": Limit(
        4 * GIB, "bytes", "every spike of 3,000 queries to 20,000 places at the default settings"
    ),
    "simulation_operations": Limit(
        10**12, "operations", "380 queries to 20,000 places at the default settings, every synapse in every step: hours"
    ),
    "events": Limit(10_000_000_000, "events", "three hours at a million a second; read three times, they take hours"),
    "event_chunk_bytes": Limit(64 * MIB, "bytes", "a million events of 64 bytes, ten times what files of events have"),
    "event_packet_bytes": Limit(
        256 * MIB, "bytes", "16 million events; DV writes a packet every 10 ms, of a thousandth of that"
    ),
    "sensor_pixels": Limit(8_294_400, "pixels", "3840 x 2160, nine times the largest event camera; they take 200 MB"),
    "video_parts": Limit(10_000_000, "parts", "46 hours of 60 frames a second; a walk over them takes half a minute"),
    "presentation_operations": Limit(
        4_000_000_000,
        "operations",
        "150 times a query to 20,000 places at the default settings; some seconds on one core",
    ),
    "presentation_bytes": Limit(GIB, "bytes", "ten times VPRSNN's network when every neuron learns at once"),
    "training_operations": Limit(
        10**13,
        "operations",
        "some hours; fifty times the default settings on 20,000 places, twice VPRSNN's 60 epochs over two traverses of "
        "3,300 places",
    ),
}
"""Every limit by its name."""


def variable(name: str) -> str:
    """The environment variable that sets the limit ``name``."""
    return f"LAVA_VPR_MAX_{name.upper()}"


_NOTES = logging.getLogger("lava_vpr")
_OURS = "LAVA_VPR_"
_OTHERS = {f"{_OURS}{name}" for name in ("DATA", "PEERS", "SANAFE", "WAYS")}
"""Variables of the benchmarks and tests, and of the host programs in bundles."""


def check_variables() -> None:
    """Refuse a limit's variable that is wrong, whether it is needed or not; note each that nobody knows.

    Raises:
        ConfigError: as `limit`.
    """
    for name in LIMITS:
        limit(name)
    known = _OTHERS.union(map(variable, LIMITS))
    for name in sorted(name for name in os.environ if name.startswith(_OURS) and name not in known):
        near = difflib.get_close_matches(name, known, 1)
        meant = f"; is {near[0]} meant?" if near else ""
        _NOTES.warning(f"{name} is no variable that lava-vpr knows{meant}")


def limit(name: str) -> int:
    """The most that the limit ``name`` allows now.

    Raises:
        ConfigError: its environment variable holds no whole number above 0.
    """
    text = os.environ.get(variable(name))
    if text is None:
        return LIMITS[name].default
    if not (text.isascii() and text.isdigit() and len(text) <= 18 and int(text) > 0):
        raise ConfigError(f"{variable(name)} is {brief(text)}, but must be a whole number above 0; correct or unset it")
    return int(text)


def excess(name: str, amount: int) -> str | None:
    """What a message says of an ``amount`` beyond the limit ``name``, with the remedy; None if it is within.

    Raises:
        ConfigError: the limit's environment variable holds no whole number above 0.
    """
    most = limit(name)
    if amount <= most:
        return None
    return f"{amount:,} {LIMITS[name].unit}, more than the {most:,} allowed; if the file is sound, set {variable(name)}"


def within(name: str, amount: int, said: str = "has") -> None:
    """Refuse an ``amount`` beyond the limit ``name``, after ``said``: of what, and that it has it.

    Raises:
        InputError: it is beyond.
        ConfigError: as `excess`.
    """
    beyond = excess(name, amount)
    if beyond is not None:
        raise InputError(f"{said} {beyond}")


def unpacking(name: str, unpacked: int, packed: int) -> str | None:
    """What a message says of a file that unpacks to too much, after "unpacks to"; None if it does not.

    Args:
        name: The limit on the bytes that it unpacks to; beyond `_UNSUSPICIOUS` it is held to ``unpacked_times``, too.
        unpacked, packed: Bytes of all that is in it, and of the file.
    """
    beyond = excess(name, unpacked)
    if beyond is None and unpacked > _UNSUSPICIOUS:
        beyond = excess("unpacked_times", unpacked // packed)
    return beyond
