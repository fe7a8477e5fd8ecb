"""``lava-vpr extend``, ``remove`` and ``merge``: a map that changes without learning what it knows again; ``export``
and ``import``.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import click

from lava_vpr import maps, model as model_file
from lava_vpr.backends.asking import open_model
from lava_vpr.cli.choose import reference_positions_options
from lava_vpr.cli.common import PATH, Number, Parsed, RegisteredName, console, stage, stderr
from lava_vpr.cli.nouns import crop_option, every_option, jobs_option, place_range, places_option, skip_option
from lava_vpr.cli.outputs import Outputs
from lava_vpr.cli.show.learning import TERMINAL
from lava_vpr.cli.train import describe, tell
from lava_vpr.cluster.tasks import Pool
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import InputError, ModelFileError, brief, shown
from lava_vpr.exchange.formats import FORMATS, TIME_STEP, FileOptions, format_of, imported
from lava_vpr.learning.references import encode_references, located_each
from lava_vpr.maps.changes import check_extension, check_learned
from lava_vpr.model import Model, lif_model
from lava_vpr.positions.frames import Positions
from lava_vpr.show.numbers import counted
from lava_vpr.storage.writing import only_one
from lava_vpr.training.measuring import calibrated
from lava_vpr.training.preparing import check_references
from lava_vpr.training.stretches import learning_bar
from lava_vpr.traverse import Traverse, open_traverses, ranges_of, readable

_OUTPUT = "File to write (default: MODEL, replaced in one step when the new one is complete)."

duplicates_option = click.option(
    "--allow-duplicates", is_flag=True, help="Accept images that the map already has; otherwise they are refused."
)


def place_ranges(text: str) -> tuple[tuple[int, int], ...]:
    """Absolute indices and ranges of them, with commas between: ``120,130:140``; `ValueError`: the text is none."""
    ranges = []
    for word in text.split(","):
        if word.isascii() and word.isdigit() and len(word) <= 18:
            ranges.append((int(word), int(word) + 1))
        elif ":" in word:
            ranges.append(place_range(word))
        else:
            raise ValueError(f"{brief(word)} is neither an index nor a range A:B; give for instance 120,130:140")
    return tuple(ranges)


@click.command()
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("images", nargs=-1, required=True, type=str, metavar="IMAGES...")
@click.option("-o", "--output", type=PATH, default=None, metavar="MODEL", help=_OUTPUT)
@places_option("Images A..B-1 of each of IMAGES (default: all).")
@every_option
@skip_option
@reference_positions_options
@duplicates_option
@crop_option
@jobs_option
def extend(
    model_path: Path,
    images: tuple[str, ...],
    output: Path | None,
    places: tuple[int, int] | None,
    every: float,
    skip_unreadable: bool,
    allow_duplicates: bool,
    crop: str,
    jobs: int | None,
    **where: Any,
) -> None:
    """Add places to a model, learned with its own settings; what it has learned does not change.

    IMAGES are one folder, list or video for each traverse that MODEL was learned from. The result equals, byte for
    byte, a model trained on all places together in the same stretches (train --parts). Images from another part of the
    same traverse keep their absolute indices, if that traverse has as many images in all and the model has none of
    these. All others are numbered after its route. A model with positions needs positions of the new places, too; one
    without takes none. An interrupted extend starts over; until it is done, MODEL does not change.
    """
    target = model_path if output is None else output
    with _changed(model_path, target, images, (*where["positions"], *map(Path, where["stamps"]))) as outputs:
        model, pool = model_file.load(model_path), Pool(jobs or cores())
        check_learned(model, "extending", model_path)
        whole = open_traverses(images, every=every, events=model.config.events)
        outputs.spare(path for traverse in whole for path in traverse.paths)
        chosen = located_each(_ranges(whole, places, skip_unreadable, where), list(map(len, whole)), **where)
        check_references([len(traverse) for traverse in chosen], images, least=1)
        stretches = check_extension(model, len(chosen[0]), len(chosen), model_path)
        known = _positions(model, chosen[0], bool(where["positions"]), model_path)
        references = encode_references(chosen, model.config, model.standard, TERMINAL, threads=pool.threads, crop=crop)
        extending = partial(maps.extend, model, references, allow_duplicates=allow_duplicates)
        started = time.perf_counter()
        with learning_bar(TERMINAL, stretches, model.config, len(chosen)) as bar:
            made = extending(route_images=len(whole[0]), positions=known, pool=pool, progress=bar.show)
        seconds = time.perf_counter() - started
        _save(made, target)
    new = made.place_indices[model.places :]
    _report(made, f"learned {counted(len(new), 'place')} more, {ranges_of(new)}, in {seconds:.1f} s", target)


@click.command()
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("places", metavar="PLACES", type=Parsed("PLACES", place_ranges))
@click.option("-o", "--output", type=PATH, default=None, metavar="MODEL", help=_OUTPUT)
@jobs_option
def remove(model_path: Path, places: tuple[tuple[int, int], ...], output: Path | None, jobs: int | None) -> None:
    """Remove places from a model; what it has learned of the others does not change.

    MODEL is a file, not a bundle. PLACES are absolute indices, as eval and query report them, and ranges A:B, with
    commas between: 120,130:140. A neuron is removed with the place that it responds to most, of those that it has
    learned.
    """
    target = model_path if output is None else output
    with _changed(model_path, target):
        model = model_file.load(model_path)
        indices = itertools.chain.from_iterable(itertools.starmap(range, places))
        with stage(f"joining what is left of {model.places:,} places"):
            made = maps.remove(model, indices, path=model_path, pool=Pool(jobs or cores()))
        _save(made, target)
    gone, lost = model.places - made.places, model.neurons - made.neurons
    _report(made, f"removed {counted(gone, 'place')} with {counted(lost, 'neuron')}", target)


@click.command()
@click.argument("model_paths", nargs=-1, required=True, metavar="MODEL...", type=PATH)
@click.option("-o", "--output", required=True, type=PATH, metavar="MODEL", help="File to write (.lvpr).")
@duplicates_option
@jobs_option
def merge(model_paths: tuple[Path, ...], output: Path, allow_duplicates: bool, jobs: int | None) -> None:
    """Join models with equal settings into one; what they have learned does not change.

    MODEL is a file; give two or more. Places keep the order of the files. Absolute indices are those that extending the
    first by the images of the others would give.
    """
    if len(model_paths) < 2:
        raise click.UsageError("there is nothing to merge; give two models or more")
    for path in model_paths:
        _refuse_bundle(path)
    Outputs((output,), read=model_paths)
    with only_one(output):
        models = [model_file.load(path) for path in model_paths]
        with stage(f"joining {len(models)} models"):
            pool = Pool(jobs or cores())
            made = maps.merge(models, paths=model_paths, allow_duplicates=allow_duplicates, pool=pool)
        _save(made, output)
    _report(made, f"merged {len(models)} models", output)


def _ranges(
    whole: Sequence[Traverse], places: tuple[int, int] | None, skip: bool, where: Mapping[str, Any]
) -> list[Traverse]:
    """The images of each traverse that are wanted; without those that cannot be read, if these are to be skipped."""
    ranges = [traverse.between(*places) if places else traverse for traverse in whole]
    if not skip:
        return ranges
    with stage("looking for images that cannot be read"):
        return readable(ranges, where["positions"])


def _save(model: Model, path: Path) -> None:
    """Write ``model`` with its calibration."""
    with stage("calibrating probabilities"):
        model = calibrated(model, Pool(cores()))
    model_file.save(model, path)


@contextmanager
def _changed(model: Path, target: Path, images: tuple[str, ...] = (), read: tuple[Path, ...] = ()) -> Iterator[Outputs]:
    """Hold ``target`` for this process, which is the ``model`` itself or another file that may be written.

    Raises:
        InputError: it may not be written.
        ModelFileError: the model is a bundle.
    """
    _refuse_bundle(model)
    in_place = os.path.realpath(model) == os.path.realpath(target)
    outputs = Outputs((target,), model=None if in_place else model, images=images, read=read)
    with only_one(target):
        yield outputs


def _positions(model: Model, traverse: Traverse, given: bool, path: Path) -> Positions | None:
    """Where the new places are, if the model knows that of its own.

    Args:
        model: The model.
        traverse: The new places.
        given: Whether the user gave positions; else they follow from the names of files, if at all.
        path: The file of the model.
    Raises:
        InputError: one has positions, the other none.
    """
    if model.positions is None:
        if given:
            raise InputError(
                f"{shown(path)}: the model does not know where its places are; leave out "
                "--positions, or train it with them"
            )
        return None
    if traverse.positions is None:
        raise InputError(
            f"{shown(path)}: the model knows where its places are, but nothing tells where those of "
            f"{shown(traverse.source)} are; give --positions FILE"
        )
    return traverse.positions


def _refuse_bundle(path: Path) -> None:
    """Refuse a folder, before anything of it is read.

    Raises:
        ModelFileError: it is one.
    """
    if path.is_dir():
        raise ModelFileError(
            f"{shown(path)}: is a folder; a bundle does not hold what the network has learned: use the model file that "
            "it was deployed from"
        )


def _report(model: Model, done: str, path: Path) -> None:
    """Print what was done, and what the model is now."""
    stretches = f"{len(model.stretches)} stretch{'es' if len(model.stretches) > 1 else ''}"
    parts = f"{counted(model.places, 'place')} in {stretches}"
    tell(model, f"{done}: {parts}, {describe(model)}\nmodel: {shown(path)}")


_FORMAT = "Format of the file (default: the one of its ending)."

time_step_option = click.option(
    "--time-step",
    type=Number(0, 1000, min_open=True),
    default=TIME_STEP,
    show_default=True,
    metavar="SECONDS",
    help="Length of a step, for formats with time constants; import: if the file does not say.",
)


@click.command()
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.option("-o", "--output", required=True, type=PATH, metavar="FILE", help="File to write (.nir, .net).")
@click.option("--format", "name", type=RegisteredName(FORMATS), default=None, help=_FORMAT)
@time_step_option
@click.option(
    "--references/--no-references",
    default=True,
    show_default=True,
    help="Include settings, names of places, responses and small images, so that import restores the model.",
)
def export(model_path: Path, output: Path, name: str | None, time_step: float, references: bool) -> None:
    """Write the network of MODEL in a format that other programs read.

    The file's metadata hold what the format cannot express (docs/exchange.md). MODEL is a file or a bundle.
    """
    row = format_of(output, name)
    Outputs((output,), model=model_path)
    model = lif_model(open_model(model_path), f"format {row.name}", model_path)
    with stage(f"writing {shown(output)}"):
        notes = row.write(model, output, FileOptions(time_step, references))
    for note in notes:
        stderr.print(f"note: {note}")
    network = model.network
    console.print(
        f"{network.inputs} inputs, {network.neurons} excitatory and {network.inhibitory} inhibitory neurons, "
        f"{'with' if references else 'without'} references\n{row.name}: {shown(output)}"
    )


@click.command("import")
@click.argument("path", metavar="FILE", type=PATH)
@click.option("-o", "--output", required=True, type=PATH, metavar="MODEL", help="File to write (.lvpr).")
@click.option("--format", "name", type=RegisteredName(FORMATS), default=None, help=_FORMAT)
@click.option(
    "--like",
    type=PATH,
    default=None,
    metavar="MODEL",
    help="Model whose settings and references the network takes over (default: those in FILE).",
)
@time_step_option
def import_model(path: Path, output: Path, name: str | None, like: Path | None, time_step: float) -> None:
    """Make a model from the network in FILE, which export or another program has written.

    An unaltered file of export restores its model, byte for byte. Any other network is rounded to the chip's integers
    where necessary, and answers with the references of --like, or of the file itself.
    """
    row = format_of(path, name)
    Outputs((output,), read=(path,), model=like)
    with only_one(output):
        other = None if like is None else open_model(like)
        with stage(f"making a model of {shown(path)}"):
            made = imported(path, row, other, time_step=time_step, threads=cores())
        model_file.save(made.model, output)
    for note in made.notes:
        stderr.print(f"note: {note}")
    tell(made.model, f"imported {made.model.places} places: {describe(made.model)}\nmodel: {shown(output)}")
