"""``lava-vpr train``; what it says of a model in the end is shared with ``extend``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from lava_vpr import model as model_file
from lava_vpr.backends.answering import paired
from lava_vpr.backends.asking import Asking
from lava_vpr.cli.choose import reference_positions_options
from lava_vpr.cli.common import (
    PATH,
    Number,
    RegisteredName,
    console,
    encode_queries,
    seed_type,
    setting_type,
    stderr,
    whole_numbers,
)
from lava_vpr.cli.nouns import crop_option, dataset_options, every_option, jobs_option, places_option, skip_option
from lava_vpr.cli.outputs import Outputs
from lava_vpr.cli.show.clusters import cluster_option, pool_at
from lava_vpr.cli.show.headings import IMAGES, LEARNED, OUTPUT, SEASON, Headed, under
from lava_vpr.cli.show.learning import TERMINAL
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import PRESETS, Config, LifNetwork, StdpLearning, integer_config
from lava_vpr.errors import ConfigError, shown
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.learning.route import Training
from lava_vpr.model import Model
from lava_vpr.season.file import save as save_season
from lava_vpr.show.numbers import counted
from lava_vpr.storage.writing import only_one
from lava_vpr.training.checkpoint import remove_checkpoint
from lava_vpr.training.trainers import LEARNING, OWN
from lava_vpr.traverse import Traverse, open_traverse, readable
from lava_vpr.truth.alignment import shown_places


@click.command(cls=Headed)
@click.argument("references", nargs=-1, required=True, type=str, metavar="REFERENCE...")
@under(
    OUTPUT,
    click.option("-o", "--output", required=True, type=PATH, metavar="MODEL", help="File to write (.lvpr)."),
)
@under(
    LEARNED,
    click.option(
        "--preset",
        type=click.Choice(list(PRESETS)),
        default=None,
        help="loihi: integer network for the chip (default); balanced: the same with half of the steps, and less "
        "energy; fast: finer orientations, coarser weights and a quarter of the steps, for the least energy; accurate: "
        "finer orientations and contrast to a place's surroundings, for the highest recall; paper: VPRSNN's "
        "conductance model as released, except that each presentation starts from rest, delays are kept for "
        "testing, and spikes of the rest are not carried over.",
    ),
    click.option("--config", type=PATH, default=None, metavar="FILE", help="Settings in TOML."),
)
@places_option("Images A..B-1 of each REFERENCE (default: all).")
@every_option
@skip_option
@dataset_options
@under(
    LEARNED,
    click.option("--input", type=RegisteredName(INPUTS), default=None, help="What the inputs encode."),
)
@under(
    IMAGES,
    click.option(
        "--events",
        is_flag=True,
        help="REFERENCE are images of events: learn them like recordings of events, with the input 'events', three "
        "views and the decoder 'standard' unless set otherwise.",
    ),
    click.option(
        "--window-events",
        type=click.IntRange(1, 1_000_000_000),
        default=None,
        metavar="N",
        help="Number of events in an image, however long they take.",
    ),
    click.option(
        "--window-ms",
        type=Number(min=0.1, max=3_600_000),
        default=None,
        metavar="MS",
        help="Milliseconds of events in an image, for a recording of an event camera.  "
        f"[default: {EventsConfig.window_ms:g}]",
    ),
)
@under(
    LEARNED,
    click.option(
        "--epochs", type=setting_type(StdpLearning, "epochs"), default=None, help="How often every image is shown."
    ),
    click.option(
        "--neurons",
        type=setting_type(LifNetwork, "neurons", 1),
        default=None,
        help="Excitatory neurons of each stretch.",
    ),
    click.option(
        "--stretch",
        type=setting_type(Config, "stretch"),
        default=None,
        help="Maximum number of places that are learned together; 0: the whole route at once.  [default: 100]",
    ),
    click.option(
        "--parts",
        type=whole_numbers(),
        default=(),
        help="Numbers of places of consecutive parts of the route, for instance 500,10: each part is cut into "
        "stretches separately, as if it had been learned alone and merged.",
    ),
    click.option(
        "--views",
        type=setting_type(ViewsConfig, "shifts"),
        default=None,
        help="Sideways views of every place, an odd number; each view has its own neurons.  [default: 1]",
    ),
    click.option(
        "--weight-bits", type=setting_type(LifNetwork, "weight_bits"), default=None, help="Bits of one weight."
    ),
    click.option(
        "--learning",
        type=RegisteredName(LEARNING),
        default=None,
        help="How weights are learned (default: float); "
        + "; ".join(f"{row.name}: {row.title}" for row in OWN[1:])
        + ".",
    ),
)
@reference_positions_options
@under(
    IMAGES,
    click.option(
        "--spacing",
        type=Number(min=0, min_open=True),
        default=None,
        metavar="M",
        help="Learn a place every M metres, not every image; needs positions.",
    ),
    click.option(
        "--keyframes",
        type=Number(min=0, max=1, min_open=True),
        default=None,
        metavar="X",
        help="Learn only images whose input changed by X since the place before: 1 - cosine, above 0 to 1.",
    ),
)
@under(
    LEARNED,
    click.option(
        "--standard",
        type=PATH,
        default=None,
        metavar="MODEL",
        help="Vectors: use the mean, scale and projection of this model instead of their own, so that both can be "
        "merged.",
    ),
)
@under(
    SEASON,
    click.option(
        "--pairs",
        type=PATH,
        default=None,
        metavar="FILE",
        help="The last REFERENCE is a part of the route in another season: learn from it which inputs survive the "
        "season, not places, and write this season to FILE (.lvps), for --season of query, eval and watch.",
    ),
    click.option(
        "--gt",
        type=PATH,
        default=None,
        metavar="FILE",
        help="Place of each image of that part, as for eval (default: that with the same file name).",
    ),
)
@crop_option
@jobs_option
@cluster_option
@click.option("--seed", type=seed_type, default=None, help="Seed of start weights and spikes.  [default: 0]")
@click.option("--resume", is_flag=True, help="Resume an interrupted training from its checkpoint.")
def train(
    references: tuple[str, ...],
    output: Path,
    jobs: int | None,
    address: str | None,
    pairs: Path | None,
    gt: Path | None,
    **options: Any,
) -> None:
    """Learn the places of a route.

    REFERENCE is a folder of images (naturally sorted), a text or CSV list of image files, or a video; or a file of
    vectors (.npy, .npz, .h5), one for each image, made by another program. Several REFERENCEs are traverses of the same
    route, where image i of each shows place i. If each has positions, they may differ in length: the images nearest to
    the places of the first are taken. With --pairs, the last REFERENCE shows some of these places in another season.
    With --dataset, REFERENCE is the folder that holds a benchmark dataset (lava-vpr datasets). While it learns,
    progress is saved beside MODEL in a .checkpoint file, from which --resume continues.
    """
    checkpoint = output.with_name(output.name + ".checkpoint")
    learned, other = _parted(references, pairs, gt, options["dataset"])
    training = Training.of(learned, checkpoint=checkpoint, **options)
    if other and not integer_config(training.start, "--pairs").network.signed:
        raise ConfigError("--pairs needs neurons with biases, which signed weights have; train with network.signed")
    sources = (*training.selection.sources, *other)
    outputs = Outputs((output, checkpoint, pairs), read=(*training.files, gt), images=sources)
    part = [open_traverse(source, every=training.every, events=training.start.events) for source in other]
    outputs.spare(path for traverse in part for path in traverse.paths)
    with only_one(output), pool_at(address, jobs) as pool:
        done = training.learn(pool, TERMINAL, opened=outputs.spare)
        model = done.model
        model_file.save(model, output)
        remove_checkpoint(checkpoint)
        if pairs is not None:
            _teach(model, (readable(part) if training.skip_unreadable else part)[0], gt, training.crop, pool, pairs)
    among = f" in {len(model.stretches)} stretches" if len(model.stretches) > 1 else ""
    tell(model, f"learned {model.places} places{among} in {done.took}: {describe(model)}\nmodel: {shown(output)}")


def _parted(
    references: tuple[str, ...], pairs: Path | None, gt: Path | None, dataset: str | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The references whose places are learned, and the one that shows some of them in another season, if any does."""
    if pairs is None:
        if gt is not None:
            raise click.UsageError("--gt says what the part in another season shows; give --pairs FILE, too")
        return references, ()
    if dataset is not None or len(references) < 2:
        raise click.UsageError("--pairs needs two traverses: the route, and a part of it in another season")
    return references[:-1], references[-1:]


def _teach(model: Model, part: Traverse, gt: Path | None, crop: str, pool: Pool, path: Path) -> None:
    """Let a part of the route in another season teach, and write what it taught to ``path``."""
    places = shown_places(model, part, gt)
    (queries,) = encode_queries(part, model, Asking(crop=crop))
    known = paired(model, queries, places, pool)
    save_season(known, path)
    console.print(f"season: {shown(path)}, taught by {known.taught} of {len(part)} images")


def describe(model: Model) -> str:
    """A model's network and what it does for its references, in one line."""
    figures = model.training
    idle = model.neurons - round(figures["neurons_used"])
    lacking = model.places - round(figures["places_covered"])
    bits = f"{model.weight_bits}-bit weights" if model.weight_bits else "float weights"
    return (
        f"{model.neurons} neurons, {bits}, {figures['spikes_per_image']:.1f} spikes an image; "
        + (f"{counted(idle, 'neuron')} without a place; " if idle else "")
        + (f"{counted(lacking, 'place')} without a neuron" if lacking else "every place has a neuron")
    )


def tell(model: Model, said: str) -> None:
    """Print ``said``, and a warning if the network of ``model`` does nothing."""
    console.print(said)
    if not model.training["neurons_used"]:
        stderr.print(
            "warning: no neuron spikes for any place, so nothing can be recognised; check the images and settings"
        )
