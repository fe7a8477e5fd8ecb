"""``lava-vpr train``; what it shows while it learns, and says of a model in the end, is shared with ``extend``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from lava_vpr import model as model_file
from lava_vpr.backends.opening import open_model
from lava_vpr.cli.common import (
    PATH,
    F,
    Number,
    Numbers,
    RegisteredName,
    console,
    encode_in_views,
    every_option,
    places_option,
    progress_bar,
    seed_type,
    setting_type,
    stage,
    stderr,
)
from lava_vpr.cli.outputs import Outputs
from lava_vpr.cli.published.options import BenchmarkOptions, benchmark_options
from lava_vpr.cli.show.clusters import cluster_at, cluster_option
from lava_vpr.cli.show.learning import learning_bar
from lava_vpr.cli.whereabouts import WhereEach, reference_positions_options
from lava_vpr.config import PRESETS, Config, LifNetwork, StdpLearning, for_events, preset
from lava_vpr.configfile import read_toml, update
from lava_vpr.encoding import EncodedTraverse, Keep
from lava_vpr.engine.threads import cores
from lava_vpr.events.files import is_recording
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.inputs.vectors import Standard
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.model import Model
from lava_vpr.slayer.front_end import learned_filters
from lava_vpr.storage.locking import only_one
from lava_vpr.storage.text import shown
from lava_vpr.training.calibration import calibrated
from lava_vpr.training.checkpoint import check_resume, remove_checkpoint
from lava_vpr.training.door import check_references
from lava_vpr.training.keyframes import choose_places
from lava_vpr.training.loop import check_size
from lava_vpr.training.loop import train as train_model
from lava_vpr.training.standard import check_asked, fitted, in_words, settings_for, standard_like
from lava_vpr.training.trainers import LEARNING, rule_settings
from lava_vpr.traverse import Traverse, open_traverses


def window_options(command: F) -> F:
    """Give a command that learns the options ``--window-ms`` and ``--window-events``."""
    text = "Milliseconds of events that an image shows, of a recording of an event camera.  [default: {:g}]"
    most = Number(min=0.1, max=3_600_000)
    said = text.format(EventsConfig.window_ms)
    command = click.option("--window-ms", type=most, default=None, metavar="MS", help=said)(command)
    text = "Events that an image shows, whatever time they take."
    count = click.IntRange(1, 1_000_000_000)
    return click.option("--window-events", type=count, default=None, metavar="N", help=text)(command)


@click.command()
@click.argument("references", nargs=-1, required=True, type=str, metavar="REFERENCE...")
@click.option("-o", "--output", required=True, type=PATH, metavar="MODEL", help="File to write (.lvpr).")
@click.option(
    "--preset",
    "preset_name",
    type=click.Choice(list(PRESETS)),
    default=None,
    help="loihi: integer network for the chip (default); balanced, fast: the same with half and a quarter of the "
    "steps, and less energy; paper: VPRSNN's conductance model, as coded but that every presentation "
    "starts from rest, delays are kept for testing, and spikes of the rest are not carried over.",
)
@click.option("--config", "config_file", type=PATH, default=None, metavar="FILE", help="Settings in TOML.")
@places_option("Images A..B-1 of each REFERENCE (default: all).")
@every_option
@benchmark_options
@click.option("--input", "input_kind", type=RegisteredName(INPUTS), default=None, help="What the inputs encode.")
@click.option(
    "--events",
    is_flag=True,
    help="REFERENCE are images of events: learn them as recordings of events are learned, with the input 'events', "
    "three views and the decoder 'standard' where nothing else is said.",
)
@window_options
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
    type=Numbers(),
    default=(),
    help="Places of consecutive parts of the route, for instance 500,10: each is cut into stretches by itself, as if "
    "it had been learned alone and merged.",
)
@click.option(
    "--views",
    "views",
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
    "change",
    type=Number(min=0, max=1, min_open=True),
    default=None,
    metavar="X",
    help="Learn only images whose input changed by X since the place before: 1 - cosine, above 0 to 1.",
)
@click.option(
    "--standard",
    "like",
    type=PATH,
    default=None,
    metavar="MODEL",
    help="Vectors: measure them by the mean, scale and projection of this model, not their own, so that both can be "
    "merged.",
)
@click.option("--jobs", type=click.IntRange(1, 1024), default=None, help="Threads (default: all processors).")
@cluster_option
@click.option("--seed", type=seed_type, default=None, help="Seed of start weights and spikes.  [default: 0]")
@click.option("--resume", is_flag=True, help="Go on from the checkpoint of a training that was interrupted.")
def train(
    references: tuple[str, ...],
    output: Path,
    preset_name: str | None,
    config_file: Path | None,
    places: tuple[int, int] | None,
    every: float,
    benchmark: BenchmarkOptions,
    parts: tuple[int, ...],
    jobs: int | None,
    resume: bool,
    where: WhereEach,
    spacing: float | None,
    change: float | None,
    like: Path | None,
    address: str | None,
    **options: Any,
) -> None:
    """Learn the places of a route.

    REFERENCE is a folder of images (naturally sorted), a text or CSV list of image files, or a video; or a file of
    vectors (.npy, .npz, .h5), one for each image, which another program made of them. Several are several traverses of
    the same route, where image i of each shows place i. With positions of each they may differ in length: the images
    nearest to the places of the first are taken. With --dataset, REFERENCE is the folder that holds a benchmark dataset
    (lava-vpr datasets). While it learns, progress is kept beside MODEL in a .checkpoint file,
    from which --resume goes on.
    """
    if options["window_ms"] is not None and options["window_events"] is not None:
        raise click.UsageError("--window-ms and --window-events both say how long a window is; give one of them")
    if spacing is not None and change is not None:
        raise click.UsageError("--spacing and --keyframes both say which images become places; give one of them")
    options["events"] = options["events"] or any(is_recording(source) for source in references)
    config = settings(preset_name, config_file, options)
    checkpoint = output.with_name(output.name + ".checkpoint")
    route = benchmark.learned(references, every, places=places, keyframes=change)
    outputs = Outputs((output, checkpoint), read=(config_file, like, *where.files), images=route.sources)
    with only_one(output), cluster_at(address) as cluster:
        check_resume(checkpoint, resume)
        whole = open_traverses(route.sources, every=route.every, events=config.events)
        outputs.spare(path for traverse in whole for path in traverse.paths)
        ranges = route.sampled(whole, places)
        if options["input_kind"] is not None:
            check_asked(ranges, config)
        config = settings_for(config, ranges)
        located = where.of(ranges, [len(traverse) for traverse in whole])
        chosen = route.of_section(_places(located, config, route.spacing(spacing, located), change))
        check_references([len(traverse) for traverse in chosen], route.sources)
        stretches = check_size(len(chosen[0]), config, len(chosen), parts)
        config = with_front_end(config, chosen[0])
        standard = _standard(chosen, config, like)
        encoded = encode_references(chosen, config, standard)
        started = time.perf_counter()
        try:
            with learning_bar(stretches, config, len(chosen), here=cluster is None) as bar:
                model = train_model(
                    encoded,
                    config,
                    route_images=len(whole[0]),
                    positions=chosen[0].positions,
                    standard=standard,
                    parts=parts,
                    jobs=jobs or cores(),
                    cluster=cluster,
                    checkpoint=checkpoint,
                    resume=resume,
                    progress=bar.show,
                    resumed=bar.resumed(checkpoint),
                )
        except KeyboardInterrupt:
            if checkpoint.exists():
                stderr.print(f"progress is kept in {shown(checkpoint)}; go on with --resume")
            raise
        with stage("calibrating probabilities"):
            model = calibrated(model, cores(), cluster)
        seconds = time.perf_counter() - started
        model_file.save(model, output)
        remove_checkpoint(checkpoint)
    among = f" in {len(model.stretches)} stretches" if len(model.stretches) > 1 else ""
    tell(model, f"learned {model.places} places{among} in {seconds:.1f} s: {describe(model)}\nmodel: {shown(output)}")


def with_front_end(config: Config, first: Traverse) -> Config:
    """``config`` with the filters that the images of ``first`` teach, if it asks for such inputs and has none.

    Raises:
        ConfigError: lava-dl is missing.
    """
    if config.encoder.kind != "filters" or config.encoder.filters:
        return config
    stderr.print(f"note: the filters of the inputs are learned from {shown(first.source)}")
    return update(config, {"encoder": {"filters": learned_filters(first.images(), config)}})


def _places(traverses: list[Traverse], config: Config, spacing: float | None, change: float | None) -> list[Traverse]:
    """The images of each traverse that become places; how many, if not all do, is told."""
    first = traverses[0]
    if change is None:
        chosen = choose_places(traverses, config.encoder, spacing=spacing)
    else:
        standard = fitted(config, traverses)
        with progress_bar(f"looking for places in {first.source}", len(first)) as advance:
            chosen = choose_places(
                traverses, config.encoder, standard=standard, change=change, progress=lambda read: advance(read, "")
            )
    if len(chosen[0]) < len(first):
        stderr.print(f"note: {len(chosen[0])} of {len(first)} images of {shown(first.source)} become places")
    return chosen


def _standard(traverses: list[Traverse], config: Config, like: Path | None) -> Standard | None:
    """What vectors are measured by, which is told; ``like`` is the model that they are to be measured like."""
    if like is None:
        standard = fitted(config, traverses)
    else:
        standard = standard_like(open_model(like).standard, config)
    if standard is not None:
        stderr.print(f"note: {in_words(config, standard)}")
    return standard


def settings(preset_name: str | None, config_file: Path | None, options: dict[str, Any]) -> Config:
    """The settings that the preset, then the file, then single options decide.

    Raises:
        ConfigError: a setting that is unknown, out of range, or contradicts another.
    """
    base = preset(preset_name) if preset_name else None
    if config_file is not None:
        config = read_toml(config_file, base)
    else:
        config = base or preset("loihi")
    if options.get("events"):
        config = for_events(config)
    changes: dict[str, Any] = {}
    for name, section, key in (
        ("input_kind", "encoder", "kind"),
        ("epochs", "learning", "epochs"),
        ("neurons", "network", "neurons"),
        ("weight_bits", "network", "weight_bits"),
        ("views", "views", "shifts"),
        ("window_ms", "events", "window_ms"),
        ("window_events", "events", "window_events"),
    ):
        if options.get(name) is not None:
            changes.setdefault(section, {})[key] = options[name]
    if options.get("learning") is not None:
        changes["learning"] = rule_settings(options["learning"], config) | changes.get("learning", {})
    changes.update({name: options[name] for name in ("seed", "stretch") if options.get(name) is not None})
    return update(config, changes)


def encode_references(
    traverses: Sequence[Traverse], config: Config, standard: Standard | None
) -> list[EncodedTraverse]:
    """The images of ``traverses`` as training takes them, in all views, with a progress bar for each."""
    return [
        seen
        # A model keeps the thumbnails of its first traverse.
        for number, traverse in enumerate(traverses)
        for seen in encode_in_views(
            traverse, config.encoder, config.views.views, Keep.ALL & ~Keep.THUMBNAILS if number else Keep.ALL, standard
        )
    ]


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
