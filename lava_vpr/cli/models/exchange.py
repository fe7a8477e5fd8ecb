"""``lava-vpr export`` and ``lava-vpr import``."""

from __future__ import annotations

from pathlib import Path

import click

from lava_vpr import model as model_file
from lava_vpr.backends.asking import open_model
from lava_vpr.cli.common import PATH, Number, RegisteredName, console, stage, stderr
from lava_vpr.cli.outputs import Outputs
from lava_vpr.cli.train import describe, tell
from lava_vpr.engine.presentations import cores
from lava_vpr.exchange.formats import FORMATS, TIME_STEP, FileOptions, format_of
from lava_vpr.exchange.opening import imported
from lava_vpr.model import integer_model
from lava_vpr.storage.text import shown
from lava_vpr.storage.writing import only_one

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
    help="Take along settings, names of places, responses and small images, so that import makes the model again.",
)
def export(model_path: Path, output: Path, name: str | None, time_step: float, references: bool) -> None:
    """Write the network of MODEL in a format that other programs read.

    What the format cannot say stands in the file's metadata and in docs/exchange.md. MODEL is a file or a bundle.
    """
    row = format_of(output, name)
    Outputs((output,), model=model_path)
    model = integer_model(open_model(model_path), f"format {row.name}", model_path)
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
    """Make a model of the network in FILE, which another program, or export, has written.

    An unaltered file of export makes the model again that it was written from, byte for byte. Any other network is
    rounded to the chip's integers where it has to be, and answers with the references of --like, or of the file itself.
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
