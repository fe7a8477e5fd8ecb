"""``lava-vpr season``."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from lava_vpr import model as model_file
from lava_vpr.backends.asking import open_model
from lava_vpr.cli.common import PATH, stage
from lava_vpr.cli.outputs import Outputs, file_writer, show_results
from lava_vpr.cli.show.headings import SEASON, under
from lava_vpr.deploy.bundle.compression import under_gains
from lava_vpr.engine.presentations import cores
from lava_vpr.model import Model, integer_model
from lava_vpr.report.images import as_png
from lava_vpr.report.season import gains_table, trusted
from lava_vpr.season.file import check_season, load, save, unlearned

_APPLIED = "Quantise MODEL again with the season in FILE."
applied_option = under(SEASON, click.option("--season", type=PATH, default=None, metavar="FILE", help=_APPLIED))
"""``--season`` of a command that takes a map to a board."""


def applied(model: Model, path: Path | None) -> tuple[Model, NDArray[np.uint8] | None]:
    """``model`` under the season in the file at ``path``, and its gains (inputs,), if there is one.

    Raises:
        LavaVprError: the file cannot be used, or not with this model.
    """
    if path is None:
        return model, None
    known = load(path)
    check_season(known, integer_model(model, "--season"))
    with stage(f"quantising {model.neurons:,} neurons under {path}"):
        return under_gains(model, known.gains, threads=cores()), known.gains


@click.command()
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("path", metavar="FILE", type=PATH)
@click.option(
    "--picture",
    type=PATH,
    default=None,
    metavar="PNG",
    help="Draw which inputs are trusted, over the image of a place.",
)
@click.option("--save", "saved", type=PATH, default=None, metavar="FILE", help="Save a copy.")
@click.option(
    "--apply",
    "target",
    type=PATH,
    default=None,
    metavar="MODEL",
    help="Write the map with its weights multiplied by the gains in FILE.",
)
@click.option("--forget", is_flag=True, help="Empty the season in FILE, after the other options.")
def season(
    model_path: Path, path: Path, picture: Path | None, saved: Path | None, target: Path | None, forget: bool
) -> None:
    """Describe the season in FILE, written by watch --learn; draw, save, apply or forget it.

    MODEL is any map with the inputs that FILE was learned with. MODEL does not change: --apply writes another map,
    whose learned weights are multiplied by the gains and quantised again, so that it needs neither FILE nor a host that
    multiplies. Places that it learns later have no gains.
    """
    Outputs((picture, saved, target), read=(path,), model=model_path)
    model = integer_model(open_model(model_path), "season", model_path)
    known = load(path)
    check_season(known, model)
    if picture is not None:
        with file_writer(picture) as write:
            write(as_png(trusted(model, known.gains)))
    if saved is not None:
        save(known, saved)
    if target is not None:
        model_file.save(applied(model, path)[0], target)
    if forget:
        save(unlearned(model), path)
    show_results([gains_table(known)], {})
