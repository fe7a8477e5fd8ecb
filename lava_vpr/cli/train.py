"""``lava-vpr train``; what it says of a model in the end is shared with ``extend``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from lava_vpr import model as model_file
from lava_vpr.cli.common import PATH, Number, RegisteredName, console, seed_type, setting_type, stderr, whole_numbers
from lava_vpr.cli.nouns import (
    crop_option,
    dataset_options,
    every_option,
    jobs_option,
    places_option,
    reference_positions_options,
)
from lava_vpr.cli.outputs import Outputs
from lava_vpr.cli.show.clusters import cluster_option, pool_at
from lava_vpr.cli.show.learning import TERMINAL
from lava_vpr.config import PRESETS, Config, LifNetwork, StdpLearning
from lava_vpr.errors import shown
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.learning.route import Training
from lava_vpr.model import Model
from lava_vpr.storage.writing import only_one
from lava_vpr.training.checkpoint import remove_checkpoint
from lava_vpr.training.trainers import LEARNING


@click.command()
@click.argument("references", nargs=-1, required=True, type=str, metavar="REFERENCE...")
@click.option("-o", "--output", required=True, type=PATH, metavar="MODEL", help="File to write (.lvpr).")
@click.option(
    "--preset",
    type=click.Choice(list(PRESETS)),
    default=None,
    help="loihi: integer network for the chip (default); balanced, fast: the same with half and a quarter of the "
    "steps, and less energy; paper: VPRSNN's conductance model, as coded but that every presentation "
    "starts from rest, delays are kept for testing, and spikes of the rest are not carried over.",
)
@click.option("--config", type=PATH, default=None, metavar="FILE", help="Settings in TOML.")
@places_option("Images A..B-1 of each REFERENCE (default: all).")
@every_option
@dataset_options
@click.option("--input", type=RegisteredName(INPUTS), default=None, help="What the inputs encode.")
@click.option(
    "--events",
    is_flag=True,
    help="REFERENCE are images of events: learn them as recordings of events are learned, with the input 'events', "
    "three views and the decoder 'standard' where nothing else is said.",
)
@click.option(
    "--window-events",
    type=click.IntRange(1, 1_000_000_000),
    default=None,
    metavar="N",
    help="Events that an image shows, whatever time they take.",
)
@click.option(
    "--window-ms",
    type=Number(min=0.1, max=3_600_000),
    default=None,
    metavar="MS",
    help="Milliseconds of events that an image shows, of a recording of an event camera.  "
    f"[default: {EventsConfig.window_ms:g}]",
)
@click.option(
    "--epochs", type=setting_type(StdpLearning, "epochs"), default=None, help="Times that every image is shown."
)
@click.option(
    "--neurons", type=setting_type(LifNetwork, "neurons", 1), default=None, help="Excitatory neurons of each stretch."
)
@click.option(
    "--stretch",
    type=setting_type(Config, "stretch"),
    default=None,
    help="Most places that are learned together; 0: the whole route at once.  [default: 100]",
)
@click.option(
    "--parts",
    type=whole_numbers(),
    default=(),
    help="Places of consecutive parts of the route, for instance 500,10: each is cut into stretches by itself, as if "
    "it had been learned alone and merged.",
)
@click.option(
    "--views",
    type=setting_type(ViewsConfig, "shifts"),
    default=None,
    help="Sideways views of every place, an odd number; each has neurons of its own.  [default: 1]",
)
@click.option("--weight-bits", type=setting_type(LifNetwork, "weight_bits"), default=None, help="Bits of one weight.")
@click.option(
    "--learning",
    type=RegisteredName(LEARNING),
    default=None,
    help="How weights are learned (default: float); "
    + "; ".join(f"{row.name}: {row.title}" for row in [*LEARNING.values()][1:])
    + ".",
)
@reference_positions_options
@click.option(
    "--spacing",
    type=Number(min=0, min_open=True),
    default=None,
    metavar="M",
    help="Learn a place every M metres, not every image; needs positions.",
)
@click.option(
    "--keyframes",
    type=Number(min=0, max=1, min_open=True),
    default=None,
    metavar="X",
    help="Learn only images whose input changed by X since the place before: 1 - cosine, above 0 to 1.",
)
@click.option(
    "--standard",
    type=PATH,
    default=None,
    metavar="MODEL",
    help="Vectors: measure them by the mean, scale and projection of this model, not their own, so that both can be "
    "merged.",
)
@crop_option
@jobs_option
@cluster_option
@click.option("--seed", type=seed_type, default=None, help="Seed of start weights and spikes.  [default: 0]")
@click.option("--resume", is_flag=True, help="Go on from the checkpoint of a training that was interrupted.")
def train(references: tuple[str, ...], output: Path, jobs: int | None, address: str | None, **options: Any) -> None:
    """Learn the places of a route.

    REFERENCE is a folder of images (naturally sorted), a text or CSV list of image files, or a video; or a file of
    vectors (.npy, .npz, .h5), one for each image, which another program made of them. Several are several traverses of
    the same route, where image i of each shows place i. With positions of each they may differ in length: the images
    nearest to the places of the first are taken. With --dataset, REFERENCE is the folder that holds a benchmark dataset
    (lava-vpr datasets). While it learns, progress is kept beside MODEL in a .checkpoint file,
    from which --resume goes on.
    """
    checkpoint = output.with_name(output.name + ".checkpoint")
    training = Training.of(references, checkpoint=checkpoint, **options)
    outputs = Outputs((output, checkpoint), read=training.files, images=training.selection.sources)
    with only_one(output), pool_at(address, jobs) as pool:
        model, seconds = training.learn(pool, TERMINAL, opened=outputs.spare)
        model_file.save(model, output)
        remove_checkpoint(checkpoint)
    among = f" in {len(model.stretches)} stretches" if len(model.stretches) > 1 else ""
    tell(model, f"learned {model.places} places{among} in {seconds:.1f} s: {describe(model)}\nmodel: {shown(output)}")


def describe(model: Model) -> str:
    """A model's network and what it does for its references, in one line."""
    figures = model.training
    bits = f"{model.weight_bits}-bit weights" if model.weight_bits else "float weights"
    return (
        f"{model.neurons} neurons, {bits}, {figures['spikes_per_image']:.1f} spikes per image, "
        f"{figures['neurons_used']:.0f} neurons used, {figures['places_covered']:.0f} of {model.places} places covered"
    )


def tell(model: Model, said: str) -> None:
    """Print ``said``, and a warning if the network of ``model`` does nothing."""
    console.print(said)
    if not model.training["neurons_used"]:
        stderr.print(
            "warning: no neuron spikes for any place, so nothing can be recognised; check the images and settings"
        )
