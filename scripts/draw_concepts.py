"""Draws docs/concepts.png: how an image becomes spikes, and spikes become a place. All of it is computed.

python scripts/draw_concepts.py [FILE]

The synthetic world draws the images, `lava_vpr.train` learns the summer; one winter image goes all the way.
"""

from __future__ import annotations

import numpy as np
from drawn_world import BLUE, DARK, GREEN, LIGHT, WORLD, bare, show, summer, target
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from lava_vpr import train
from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.encoding import encode_arrays
from lava_vpr.model import prepare
from lava_vpr.report.images import edge_direction
from lava_vpr.synthetic.world import render

PLACE = 32


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


def main() -> None:
    file = target("concepts.png", "Draw the picture of docs/concepts.md.")
    references, winter = summer(), render(WORLD, PLACE, "winter")
    model = train(references)
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
    show(axes["place"], references[best], aspect="auto")
    axes["place"].set_title(f"6  place {best}, as it was learned", fontsize=10)
    bare(axes, ("inputs", "neurons", "scores"))
    figure.savefig(file, dpi=110)
    print(f"{file.name}: place {PLACE} is recognised as {best}; {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
