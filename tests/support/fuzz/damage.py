"""Files of arrays, events, images, videos, bags, networks and times, damaged as disks and copies damage them, and read.

What is taken must be equal to the whole file, or content that its format cannot tell from the whole: not so where it
carries a checksum, a length or a count. Rows and events that are 0 at the end must be told.

Used by paper_table, storage and support.
"""

from __future__ import annotations

import logging
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from support.common.bags import KINDS, bag, frames
from support.common.eventfiles import WRITERS, aedat4, made, written
from support.common.imagefiles import image_bytes, smooth_picture, video
from support.fuzz.changes import Files, taken_apart, zipped

from lava_vpr.events.files import open_events, windows_of
from lava_vpr.exchange.formats import FORMATS, FileOptions, imported
from lava_vpr.images.bags import bag_samples
from lava_vpr.images.imagefiles import decode_image
from lava_vpr.images.videos import video_samples
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.model import content, integer_model, load
from lava_vpr.positions.track import read_stamps, read_track
from lava_vpr.vectors.files import read_vectors

WHOLE, OTHER = "equal to the whole file", "other content, which the format cannot tell"
Read = tuple[Any, bytes, bool]
"""How much there is, all of it, and whether its last rows are 0."""


class WrongError(Exception):
    """A file is taken though a checksum, a length, a count or a name in it, or its end, says that it is damaged."""


def changed(rng: random.Random, name: str, whole: bytes) -> tuple[str, bytes]:
    """A kind of damage, and the file so damaged."""
    n, at = len(whole), rng.randrange(len(whole))
    width, wide, other = rng.choice([1, 2, 4, 8]), rng.choice([1, 4, 48, 512]), rng.randrange(n)
    integer = rng.choice([bytes(width), b"\xff" * width, b"\x7f" + b"\xff" * (width - 1), b"\1".ljust(width, b"\0")])
    head = rng.randrange(min(n, 160))

    def turned() -> bytes:
        data = bytearray(whole)
        for _ in range(rng.choice([1, 1, 3, 16])):
            data[rng.randrange(n)] ^= 1 << rng.randrange(8)
        return bytes(data)

    kinds: dict[str, Callable[[], bytes]] = {
        "turned": turned,
        "cut": lambda: whole[:at],
        "zeroed to the end": lambda: whole[:at] + bytes(n - at),
        "zeroed": lambda: (whole[:at] + bytes(wide) + whole[at + wide :])[:n],
        "spliced": lambda: (whole[:at] + whole[other : other + wide] + whole[at + wide :])[:n],
        "inserted": lambda: whole[:at] + rng.randbytes(wide) + whole[at:],
        "deleted": lambda: whole[:at] + whole[at + wide :],
        "integer": lambda: whole[:at] + integer + whole[at + width :],
        "header": lambda: whole[:head] + rng.randbytes(1) + whole[head + 1 :],
        "mark": lambda: b"\xef\xbb\xbf" + whole,
    }
    if name.endswith(".npz"):
        entries = taken_apart(b"\n\n" + whole)[1]
        kinds["doubled"] = lambda: zipped([*entries, rng.choice(entries)])
    kind = rng.choice(list(kinds))
    return kind, kinds[kind]()


def _vectors(path: Path) -> Read:
    read = read_vectors(path)
    values = np.asarray(read.array, np.float32)
    return values.shape, values.tobytes() + repr(read.names).encode(), not values[-1].any()


def _events(path: Path) -> Read:
    parts = list(open_events(path).events())
    t, x, y = (np.concatenate([np.zeros(0), *(getattr(part, name) for part in parts)]) for name in "txy")
    windows_of(path, EventsConfig(), 1.0)
    return len(t), np.array([t, x, y]).tobytes(), any(len(a) > 1 and not a[-2:].any() for a in (x, y))


def _image(path: Path) -> Read:
    image = decode_image(path.read_bytes(), str(path))
    return image.shape, image.tobytes(), False


def _video(path: Path) -> Read:
    pictures = [sample.read().tobytes() for sample in video_samples(path)]
    return len(pictures), b"".join(pictures), False


def _bag(path: Path) -> Read:
    images = [(sample.stamp, sample.read().tobytes()) for sample in bag_samples(path, None)]
    return len(images), repr(images).encode(), False


def _network(path: Path) -> Read:
    model = imported(path, FORMATS["nir" if path.suffix == ".nir" else "netx"]).model
    header, arrays = content(model)
    return None, repr((header, {name: value.tobytes() for name, value in arrays.items()})).encode(), False


def _times(path: Path) -> Read:
    if path.name.startswith("stamps"):
        return None, read_stamps(path).tobytes(), False
    track = read_track(path)
    return None, track.positions.values.tobytes() + (b"" if track.stamps is None else track.stamps.tobytes()), False


READERS: dict[str, Callable[[Path], Read]] = {
    "vectors": _vectors,
    "events": _events,
    "image": _image,
    "video": _video,
    "bag": _bag,
    "network": _network,
    "times": _times,
}


def judged(format: str, path: Path, whole: bytes, kind: str) -> str:
    """Whether the file ``path``, which was ``whole`` before it was damaged, reads as it did, or as another may.

    Raises:
        WrongError: it is taken though something in it, or its end, says that it is damaged.
        LavaVprError: it is refused.
    """
    data, notes = path.read_bytes(), _Notes()
    path.write_bytes(whole)
    count, all_of_it, _ = READERS[format](path)
    path.write_bytes(data)
    logging.getLogger("lava_vpr").addHandler(notes)
    try:
        found, got, zeros = READERS[format](path)
    finally:
        logging.getLogger("lava_vpr").removeHandler(notes)
    if (found, got) == (count, all_of_it) and kind != "doubled":
        return WHOLE
    told = path.suffix == ".mpg" or (path.suffix == ".mp4" and data[data.find(b"moov") :] not in whole)
    why = {
        "names an array twice": kind == "doubled",
        "has a checksum": path.suffix in (".npz", ".png"),
        "is cut": kind == "cut" and format != "times" and path.suffix != ".mpg",
        f"{found}, not {count}": found != count and not told,
        "zeros at its end": zeros and not notes.told,
    }
    if any(why.values()):
        raise WrongError(f"{path}: {kind}, and taken: {', '.join(cause for cause, true in why.items() if true)}")
    return OTHER


class _Notes(logging.Handler):
    """Whether zeros at an end were told."""

    told = False

    def emit(self, record: logging.LogRecord) -> None:
        self.told = self.told or ": the last " in record.getMessage()


def files(folder: Path) -> dict[str, dict[str, Files]]:
    """The whole files of each format; ``folder`` holds a model, ``float.lvpr``."""
    found: dict[str, list[Path]] = {name: [] for name in READERS}
    place = folder / "whole"
    place.mkdir()
    vectors = np.random.default_rng(0).normal(size=(40, 16)).astype(np.float32)
    names = [f"p{k}" for k in range(40)]
    np.save(place / "v.npy", vectors)
    np.savez(place / "plain.npz", descriptors=vectors, names=names)
    np.savez_compressed(place / "packed.npz", descriptors=vectors, names=names)
    options: dict[str, dict[str, Any]] = {
        "plain": {},
        "packed": {"compression": "gzip"},
        "summed": {"fletcher32": True},
    }
    for name, said in options.items():
        with h5py.File(place / f"{name}.h5", "w", libver="latest" if name == "plain" else "earliest") as file:
            file.create_dataset("descriptors", data=vectors, chunks=(8, 16) if said else None, **said)
            file.create_dataset("names", data=names, dtype=h5py.string_dtype())
    found["vectors"] = [*place.glob("*.npy"), *place.glob("*.npz"), *place.glob("*.h5")]
    events = made(1500)
    (place / "events").mkdir()
    found["events"] = [written(kind, place / "events", events) for kind in WRITERS]
    found["events"] += [aedat4(place / "events" / f"packed{k}.aedat4", events, k) for k in (0, 3)]
    picture = smooth_picture(1, (48, 64, 3))
    kinds = {"a.png": (), "a.jpg": (), "a.bmp": (), "a.tif": (259, 1), "lzw.tif": (259, 5), "a.webp": (64, 80)}
    for name, said_of_it in kinds.items():
        found["image"].append(place / name)
        found["image"][-1].write_bytes(image_bytes(Path(name).suffix, picture, *said_of_it))
    found["image"].append(place / "deep.png")
    found["image"][-1].write_bytes(image_bytes(".png", picture.astype(np.uint16) * 257))
    codecs = {".avi": "MJPG", ".mp4": "mp4v", ".mkv": "MJPG", ".mpg": "MPG1"}
    found["video"] = [video(place / f"v{end}", 8, 25.0, codec=codec) for end, codec in codecs.items()]
    for kind in KINDS:
        whole = bag(place / f"b{kind}", frames([picture, picture[::-1], picture]), kind)
        found["bag"].append(whole if whole.is_file() else next(whole.glob(f"*.{kind}")))
    for name, end in (("nir", ".nir"), ("netx", ".net")):
        found["network"].append(place / f"n{end}")
        FORMATS[name].write(integer_model(load(folder / "float.lvpr"), "a test"), found["network"][-1], FileOptions())
    stamps = [f"{1_700_000_000 + k / 2}" for k in range(6)]
    points = "".join(f'<trkpt lat="50.{k}" lon="8"><time>2024-01-01T00:00:0{k}Z</time></trkpt>\n' for k in range(6))
    texts = {
        "stamps.csv": "time\n" + "".join(f"{stamp}\n" for stamp in stamps),
        "track.csv": "x,y,time\n" + "".join(f"{k}.5,{k},{stamp}\n" for k, stamp in enumerate(stamps)),
        "track.gpx": f'<gpx version="1.1"><trk><trkseg>\n{points}</trkseg></trk></gpx>\n',
    }
    for name, text in texts.items():
        found["times"].append(place / name)
        found["times"][-1].write_text(text)
    return {kind: {path.name: {path.name: path.read_bytes()} for path in paths} for kind, paths in found.items()}


def wrong_with(message: str, path: Path | None) -> str:
    """What is wrong with a message about ``path``; empty: it is one short printable line with the file and a remedy."""
    if not message.isprintable():
        return "MORE THAN ONE LINE, OR UNPRINTABLE"
    if path is not None and not message.startswith(str(path)):
        return "NOT THE FILE'S NAME FIRST"
    if "; " not in message or len(message.replace(str(path), "")) >= 500:
        return "NO REMEDY, OR LONG"
    return "REFUSED BY MEMORY RUNNING OUT" if "memory for" in message or "not enough memory" in message else ""
