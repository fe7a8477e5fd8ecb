"""What the costliest files that lava-vpr accepts cost it: memory and seconds of a process that reads one.

    python -m benchmarks commands.file_costs [--only NAME]

Each file is made as large as its limits allow (docs/security.md), of what packs best, so that it is as small
on the disk as they allow.
Memory is the most that the process held at any time (ru_maxrss), seconds are those of the whole process; what a
command takes that reads next to nothing stands in the first row. Making the files takes up to 12 GB and some minutes.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import click
import cv2
import h5py
import numpy as np

from benchmarks.commands.running import PROGRAM, command_run
from benchmarks.program import BenchmarkTable, Printed, program
from lava_vpr import model as model_file
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2
from lava_vpr.deploy.mapping.largest_map import largest, sizing_of
from lava_vpr.images.files import listed_images
from lava_vpr.model import Model
from lava_vpr.positions.frames import LAT_LON, Positions
from lava_vpr.positions.gpx import gpx_text, read_gpx
from lava_vpr.positions.track import read_table
from lava_vpr.storage.limits import limit
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.training.loop import split
from lava_vpr.vectors.files import read_vectors

IMAGE = "image.png"


class CostlyFile(NamedTuple):
    """A file at its limits: what it is, what reads it, what makes it, and the command that does."""

    what: str
    reader: str
    make: Callable[[Path], object]
    words: Sequence[str]


def blank(config: Config, places: int) -> Model:
    """A model of so many places that has learned nothing, with the network that the planner takes for typical."""
    network = sizing_of(config, LOIHI_2, places, "unknown", "every").network
    neurons, inputs = network.neurons, config.encoder.inputs
    thumbnails = np.zeros((places, 48, 64, 3), np.uint8)
    noisy = thumbnails[: -(-places // 8)]  # no smaller file may unpack to so much
    noisy[:] = np.random.default_rng(0).integers(0, 256, noisy.shape, np.uint8)
    return Model(
        config=config,
        network=replace(network, weights=np.ascontiguousarray(network.weights)),
        learned=np.zeros((inputs, neurons), np.float32),
        responses=np.zeros((neurons, places), np.int32),
        stretches=split(places, config),
        place_indices=np.arange(places),
        place_names=tuple(f"{place}.png" for place in range(places)),
        route_images=places,
        labels=np.arange(places),
        patches=np.zeros((places, 28, 28), np.uint8),
        activity=np.zeros((places, inputs), np.float32),
        thumbnails=thumbnails,
        training={"spikes_per_image": 0, "neurons_used": 0, "places_covered": 0},
    )


def save_blank(config: Config, places: int) -> Callable[[Path], object]:
    """Writes `blank` as ``model.lvpr``."""
    return lambda place: model_file.save(blank(config, places), place / "model.lvpr")


def deploy_blank(config: Config, places: int, board: str) -> Callable[[Path], object]:
    """Writes a bundle of `blank` for ``board``."""

    def make(place: Path) -> None:
        save_blank(config, places)(place)
        words = [*PROGRAM, "deploy", "model.lvpr", "--target", board, "--input-mode", "injected", "-o", "bundle"]
        subprocess.run(words, cwd=place, check=True, stdout=subprocess.DEVNULL)

    return make


def picture(place: Path) -> None:
    """A PNG of as many black pixels as are accepted."""
    side = int(limit("image_pixels") ** 0.5)
    cv2.imwrite(str(place / "large.png"), np.zeros((side, side, 3), np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 9])


def listing(place: Path) -> None:
    """A list of as many images as are accepted: the same one again and again."""
    (place / "long.txt").write_text(f"{IMAGE}\n" * (limit("rows") - 1))


def positions(place: Path) -> None:
    """As many positions as are accepted, as text as long as is accepted."""
    rows = limit("rows") - 2
    line = "0." + "0" * (limit("text_bytes") // rows - 6) + ",0\n"
    (place / "positions.csv").write_text("x,y\n" + line * rows)


def tracking(place: Path) -> None:
    """A GPX track of as many points as are accepted, each with what a receiver writes of it."""
    seconds = np.arange(limit("points"), dtype=np.float64)
    where = Positions(np.stack([50 + seconds / 1e5, seconds / 1e5], axis=1), LAT_LON)
    (place / "track.gpx").write_text(gpx_text(where, 1.7e9 + seconds))


def vectors(name: str) -> Callable[[Path], object]:
    """Writes vectors of 4,096 values, as many as are accepted, and so many others than 0 as they take."""

    def make(place: Path) -> None:
        array = np.zeros((limit("array_bytes") // (4 * 4096) - 1, 4096), np.float32)
        noisy = array[: len(array) // 80]
        noisy[:] = np.random.default_rng(0).normal(size=noisy.shape)
        if name.endswith(".npz"):
            np.savez_compressed(place / name, descriptors=array)
            return
        with h5py.File(place / name, "w") as file:
            file.create_dataset("descriptors", data=array, chunks=(64, 4096), compression="gzip")

    return make


def cases() -> dict[str, CostlyFile]:
    """Every case by its name."""
    loihi = preset("loihi")
    fast = preset("fast")
    long = update(loihi, {"network": {"steps": 65_536}})
    kapoho = largest(loihi, KAPOHO_BAY, weights="every").places
    query = [*PROGRAM, "query", "model.lvpr", IMAGE, "-o", "answer.csv"]
    bundle = [*PROGRAM, "query", "bundle", IMAGE, "-o", "answer.csv"]
    few = save_blank(loihi, 2)
    reading = "from pathlib import Path; from {} import {} as read; print(len(read(Path({!r}))))"

    def and_few(make: Callable[[Path], object]) -> Callable[[Path], object]:
        return lambda place: (few(place), make(place))

    def read(reader: Callable[[Path], object], path: str) -> list[str]:
        return [sys.executable, "-c", reading.format(reader.__module__, reader.__name__, path)]

    of_vectors = f"{limit('array_bytes') // (4 * 4096) - 1:,} vectors of 4,096 values"
    return {
        "nothing": CostlyFile("a model of 2 places", "`query` of one small image", few, query),
        "model": CostlyFile("a model of 20,000 places", "`query`", save_blank(fast, 20_000), query),
        "steps": CostlyFile("a model of 1,900 places and 65,536 steps", "`query`", save_blank(long, 1_900), query),
        "loihi2": CostlyFile(
            "a bundle of 16,000 places for Loihi 2", "`query`", deploy_blank(fast, 16_000, "loihi2"), bundle
        ),
        "kapoho": CostlyFile(
            f"a bundle of {kapoho:,} places for Kapoho Bay",
            "`query --backend bundle`",
            deploy_blank(loihi, kapoho, "kapoho-bay"),
            [*bundle, "--backend", "bundle"],
        ),
        "picture": CostlyFile(
            "a picture of 178,956,970 pixels (PNG)",
            "`query`",
            and_few(picture),
            [*PROGRAM, "query", "model.lvpr", "large.png", "-o", "answer.csv"],
        ),
        "list": CostlyFile(
            "a list of 2,000,000 images",
            "the reader of lists",
            listing,
            read(listed_images, "long.txt"),
        ),
        "positions": CostlyFile(
            "2,000,000 positions",
            "the reader of positions",
            positions,
            read(read_table, "positions.csv"),
        ),
        "gpx": CostlyFile(
            "a GPX track of 250,000 points",
            "the reader of positions",
            tracking,
            read(read_gpx, "track.gpx"),
        ),
        **{
            end: CostlyFile(
                f"{of_vectors} (.{end})",
                "the reader of vectors",
                vectors(f"v.{end}"),
                read(read_vectors, f"v.{end}"),
            )
            for end in ("npz", "h5")
        },
    }


@program()
@click.option("--only", multiple=True, help="Names of cases.")
def main(only: Sequence[str]) -> Printed:
    """What the costliest files cost."""
    rows, every = [], cases()
    if unknown := set(only) - set(every):
        raise click.BadParameter(f"{', '.join(sorted(unknown))}: choose among {', '.join(every)}", param_hint="--only")
    for name in only or every:
        case = every[name]
        with temporary_folder() as place:
            cv2.imwrite(str(place / IMAGE), np.random.default_rng(0).integers(0, 256, (64, 96), np.uint8))
            case.make(place)
            size = sum(file.stat().st_size for file in place.rglob("*") if file.is_file())
            run = command_run(place, *case.words)
        figures = (f"{size / 1e6:,.1f}", f"{run.held / 1e6:,.0f}", f"{run.seconds:,.1f}")
        rows.append([case.what, case.reader, *figures])
        yield f"{name}: {', '.join(figures)}; {run.used:,.1f} s of processors"
    columns = ["file", "read by", "on the disk, MB", "memory at most, MB", "seconds"]
    yield BenchmarkTable(columns, rows, record="" if only else "file-costs")
