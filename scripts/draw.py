"""Draws the pictures of README and docs: python scripts/draw.py [NAME...] [--out FOLDER]      (`make pictures`: all)

concepts.png    how an image becomes spikes, and spikes become a place
drive.webp      a drive in winter recognised on a map learned in summer; the robot stops once, and is kidnapped once
front_end.png   one image in the layers of the spiking front end, as its populations spike
season.jpg      what a map learned in summer has learned to trust by the end of a drive in winter

Everything in them is computed: the synthetic world draws the images, `lava_vpr.train` learns the summer, and a
`lava_vpr.Localizer` drives the winter.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image

matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from lava_vpr import Localizer, Match, train
from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.encoding import encode_arrays
from lava_vpr.inputs.front_end_settings import FRONT_END
from lava_vpr.model import Model, prepare
from lava_vpr.report.images import edge_direction
from lava_vpr.report.layers import Layers, picture
from lava_vpr.report.season import trusted
from lava_vpr.synthetic.world import World, render

DOCS = Path(__file__).resolve().parents[1] / "docs"
WORLD = World(seed=0, places=100, width=256, height=128)
DARK, BLUE, GREEN, GREY, LIGHT = "#111827", "#1d4ed8", "#15803d", "#6b7280", "#9ca3af"
PLACE = 32
"""The place of pictures of one image."""
STOP, CARRIED = 30, 46
DRIVE = (*range(12, STOP), *([STOP] * 5), *range(STOP + 1, CARRIED), *range(72, 96))
"""The place of each image: a stretch, five images at a stop, on, and from place 45 to place 72 in no time."""
MILLISECONDS = 180
SIZE = (8.0, 4.6)  # inches, at 100 pixels


@cache
def summer() -> NDArray[np.uint8]:
    """The references, uint8 (places, h, w, 3) BGR."""
    return np.stack([render(WORLD, place, "summer") for place in range(WORLD.places)])


@cache
def learned() -> Model:
    """The map of the summer."""
    return train(summer())


def show(axes: Axes, image: NDArray[np.uint8], **options: str) -> None:
    """An image, uint8 (h, w, 3) BGR, without ticks."""
    axes.imshow(image[..., ::-1], **options)  # type: ignore[arg-type]
    axes.set(xticks=[], yticks=[])


def bare(axes: Mapping[str, Axes], names: Iterable[str]) -> None:
    """Plots without the upper and the right line of their frames."""
    for name in names:
        axes[name].spines[["top", "right"]].set_visible(False)


def draw_edges(axes: Axes, activity: NDArray[np.float32], orientations: int, grid: int, title: str) -> None:
    """Activity float32 (orientations * grid * grid,) as strokes along the edges that each input responds to."""
    strength = activity.reshape(orientations, grid, grid) / activity.max()
    lines, widths = [], []
    for channel, row, column in np.argwhere(strength > 0.15).tolist():
        dx, dy = edge_direction(channel, orientations)
        lines.append([(column - dx / 2, row - dy / 2), (column + dx / 2, row + dy / 2)])
        widths.append(2.0 * float(strength[channel, row, column]))
    axes.add_collection(LineCollection(lines, linewidths=widths, colors=DARK))
    axes.set(xlim=(-0.5, grid - 0.5), ylim=(grid - 0.5, -0.5), aspect="equal", xticks=[], yticks=[])
    axes.set_title(title, fontsize=10)


def concepts(file: Path) -> str:
    """One winter image goes all the way."""
    model, winter = learned(), render(WORLD, PLACE, "winter")
    encoder = model.config.encoder
    (query,) = encode_arrays([winter], encoder, model.config.views.views[:1])
    backend, shown = HostBackend(), query_presentations(model, query)
    trains, counts = backend.trains(model, shown), backend.count_spikes(model, shown)[0]
    scores = prepare(model)(counts)[0]
    order = np.argsort(model.responses.argmax(axis=1), kind="stable")

    figure, axes = pyplot.subplot_mosaic(
        [["image", "edges", "inputs", "inputs"], ["neurons", "neurons", "scores", "place"]],
        figsize=(11, 5.2),
        layout="constrained",
    )
    show(axes["image"], winter, aspect="auto")
    axes["image"].set_title("1  an image, in winter", fontsize=10)
    draw_edges(
        axes["edges"],
        query.activity[0],
        encoder.orientations,
        encoder.image_size // encoder.cell,
        "2  activity: edges, by direction",
    )
    steps, inputs = np.nonzero(trains.inputs[0])
    axes["inputs"].plot(steps, inputs, ",", color=DARK, alpha=0.7)
    axes["inputs"].set(xlabel="step (ms)", ylabel="input neuron")
    axes["inputs"].set_title(f"3  rates become spikes: {len(steps):,} of {len(np.unique(inputs))} inputs", fontsize=10)
    when, who = np.nonzero(trains.exc[0][:, order])
    axes["neurons"].plot(when, who, "|", color=BLUE, markersize=5)
    axes["neurons"].set(xlabel="step (ms)", ylabel="neuron, by its place", ylim=(-1, model.neurons))
    axes["neurons"].set_title(f"4  the network: {len(who)} spikes; one neuron learned this place", fontsize=10)
    best = int(scores.argmax())
    axes["scores"].bar(range(WORLD.places), scores, color=[GREEN if k == best else LIGHT for k in range(WORLD.places)])
    axes["scores"].set(xlabel="place", yticks=[])
    axes["scores"].set_title("5  the decoder's scores", fontsize=10)
    show(axes["place"], summer()[best], aspect="auto")
    axes["place"].set_title(f"6  place {best}, as it was learned", fontsize=10)
    bare(axes, ("inputs", "neurons", "scores"))
    figure.savefig(file, dpi=110)
    return f"place {PLACE} is recognised as {best}"


@dataclass(frozen=True)
class DriveFrame:
    """What one frame shows: the winter image, uint8 (h, w, 3) BGR, where it was taken, and the answer."""

    place: int
    image: NDArray[np.uint8]
    match: Match


def frames(robot: Localizer) -> Iterator[DriveFrame]:
    """The drive, image by image."""
    for stamp, place in enumerate(DRIVE):
        image = render(WORLD, place, "winter")
        yield DriveFrame(place, image, robot.update(image, float(stamp)))


def verdict(match: Match) -> tuple[str, str]:
    """The sentence below the answer, and its colour."""
    if match.accepted:
        return f"place {match.place}: accepted, probability {match.probability:.0%}", GREEN
    if match.place < 0 or match.off_map > 0.5:
        return "no place yet", GREY
    return f"perhaps place {match.place}, probability {match.probability:.0%}: not accepted", GREY


def drawn(frame: DriveFrame, references: NDArray[np.uint8], order: NDArray[np.int64]) -> Image.Image:
    """One frame of the picture.

    Args:
        frame: What it shows.
        references: Uint8 (places, h, w, 3) BGR.
        order: The place that each neuron spikes most for, int64 (neurons,).
    """
    match, (words, colour) = frame.match, verdict(frame.match)
    figure, axes = pyplot.subplot_mosaic(
        [["now", "then"], ["spikes", "spikes"], ["belief", "belief"]],
        figsize=SIZE,
        gridspec_kw={"height_ratios": [3.2, 1, 1]},
        layout="constrained",
    )
    show(axes["now"], frame.image)
    axes["now"].set_title("what the robot sees: winter", fontsize=11)
    show(axes["then"], references[match.place] if match.accepted else np.full_like(references[0], 235))
    axes["then"].set_title("what it recognises: summer", fontsize=11)
    axes["then"].set_xlabel(words, color=colour, fontsize=11)
    for name in ("now", "then"):
        for edge in axes[name].spines.values():
            edge.set(color=colour if name == "then" else GREY, linewidth=3)
    axes["spikes"].bar(order, match.spikes, width=0.8, color=BLUE)
    axes["spikes"].set(ylim=(0, 32), yticks=[], xticks=[])
    axes["spikes"].set_ylabel("spikes", fontsize=10)
    places = [candidate.place for candidate in match.candidates]
    axes["belief"].bar(places, [c.probability for c in match.candidates], width=1.0, color=colour)
    axes["belief"].set(ylim=(0, 1), yticks=[])
    axes["belief"].set_ylabel("belief", fontsize=10)
    axes["belief"].set_xlabel("places along the route; the triangle is where the robot is", fontsize=10)
    axes["belief"].plot([frame.place], [0.93], marker="v", color="black", markersize=8)
    for name in ("spikes", "belief"):
        axes[name].set_xlim(-1, WORLD.places)
    bare(axes, ("spikes", "belief"))
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=100)
    pyplot.close(figure)
    return Image.open(buffer).convert("RGB")


def drive(file: Path) -> str:
    """The moving picture."""
    robot = Localizer(learned(), motion="any")
    order = robot.model.responses.argmax(axis=1)
    shown = list(frames(robot))
    first, *rest = [drawn(frame, summer(), order) for frame in shown]
    first.save(file, save_all=True, append_images=rest, duration=MILLISECONDS, loop=0, quality=60, method=6)
    right = sum(frame.match.accepted and frame.match.place == frame.place for frame in shown)
    accepted = sum(frame.match.accepted for frame in shown)
    return f"{len(shown)} images, {accepted} accepted, {right} of them exactly right"


def front_end(file: Path) -> str:
    """The layers of one winter image."""
    found = Layers.of(FRONT_END, render(WORLD, PLACE, "winter"), file.name)
    drawn = Image.open(io.BytesIO(picture(found))).convert("RGB")
    drawn.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return f"{FRONT_END.steps} steps"


def season(file: Path) -> str:
    """What a whole drive in winter has taught."""
    middle, robot = WORLD.places // 2, Localizer(learned(), learn=True)
    for place in range(WORLD.places):
        robot.update(render(WORLD, place, "winter"))
    known = robot.season
    if known is None:
        raise TypeError("a robot that learns knows a season")
    figure, axes = pyplot.subplots(1, 3, figsize=(11, 2.3), layout="constrained")
    titles = (
        f"place {middle}, learned in summer",
        "the same place in winter",
        f"trusted after {WORLD.places} images of winter",
    )
    images = (summer()[middle], render(WORLD, middle, "winter"), trusted(robot.model, known.gains))
    for axis, title, image in zip(axes, titles, images, strict=True):
        show(axis, image, aspect="auto")
        axis.set_title(title, fontsize=10)
    figure.savefig(file, dpi=90, pil_kwargs={"quality": 80})
    return f"{known.taught} of {known.answered} answers taught"


PICTURES: dict[str, Callable[[Path], str]] = {
    "concepts.png": concepts,
    "drive.webp": drive,
    "front_end.png": front_end,
    "season.jpg": season,
}
"""What draws each picture into a file, and says what is seen in it."""


def main() -> None:
    parser = argparse.ArgumentParser(description="Draw the pictures of README and docs.")
    parser.add_argument("names", metavar="NAME", nargs="*", help=f"of {', '.join(PICTURES)}; all by default")
    parser.add_argument("--out", type=Path, default=DOCS, help="The folder, by default docs.")
    given = parser.parse_args()
    for name in given.names or PICTURES:
        file = given.out / name
        print(f"{name}: {PICTURES[name](file)}; {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
