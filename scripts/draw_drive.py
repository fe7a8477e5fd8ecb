"""Draws docs/drive.webp, the moving picture of README: a drive in winter being recognised on a map learned in summer.

python scripts/draw_drive.py [FILE]

Everything in it is computed: the synthetic world draws the images, `lava_vpr.train` learns the summer, and a
`lava_vpr.Localizer` answers each winter image from the images so far. The robot stops once, and is kidnapped once.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from drawn_world import BLUE, GREEN, GREY, WORLD, bare, show, summer, target
from matplotlib import pyplot
from numpy.typing import NDArray
from PIL import Image

from lava_vpr import Localizer, Match, train
from lava_vpr.synthetic.world import render

STOP, CARRIED = 30, 46
DRIVE = (*range(12, STOP), *([STOP] * 5), *range(STOP + 1, CARRIED), *range(72, 96))
"""The place of each image: a stretch, five images at a stop, on, and from place 45 to place 72 in no time."""
MILLISECONDS = 180
SIZE = (8.0, 4.6)  # inches, at 100 pixels


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


def draw(frame: DriveFrame, references: NDArray[np.uint8], order: NDArray[np.int64]) -> Image.Image:
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


def main() -> None:
    file, references = target("drive.webp", "Draw the moving picture of README."), summer()
    robot = Localizer(train(references), motion="any")
    order = robot.model.responses.argmax(axis=1)
    shown = list(frames(robot))
    first, *rest = [draw(frame, references, order) for frame in shown]
    first.save(file, save_all=True, append_images=rest, duration=MILLISECONDS, loop=0, quality=60, method=6)
    right = sum(frame.match.accepted and frame.match.place == frame.place for frame in shown)
    accepted = sum(frame.match.accepted for frame in shown)
    print(f"{file.name}: {len(shown)} images, {accepted} accepted, {right} of them exactly right")
    print(f"{file.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
