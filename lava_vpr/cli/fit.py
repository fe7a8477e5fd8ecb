"""``lava-vpr fit``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lava_vpr.backends.asking import open_model
from lava_vpr.cli.common import PATH, Number, progress_bar, setting_type, stage
from lava_vpr.cli.nouns import json_option
from lava_vpr.cli.outputs import Outputs, show_results
from lava_vpr.cli.show.boards import (
    check_as_learned,
    check_dense_rows,
    dense_rows_option,
    input_mode_option,
    placed,
    rests_on,
    target_option,
    weight_bits_option,
)
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import BOARDS, Board
from lava_vpr.errors import shown
from lava_vpr.inputs.encoder import EncoderConfig
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.model import IntegerModel, lif_model
from lava_vpr.show.table import Table

if TYPE_CHECKING:
    from lava_vpr.deploy.bundle.compression import Changes
    from lava_vpr.deploy.mapping.largest_map import Capacity


@click.command()
@click.argument("model", type=PATH, required=False)
@target_option
@weight_bits_option
@input_mode_option
@dense_rows_option
@click.option(
    "--neurons-per-place",
    type=Number(min=0, min_open=True, max=100),
    default=None,
    help="Without MODEL: excitatory neurons for each place (default: 1).",
)
@click.option(
    "--views",
    type=setting_type(ViewsConfig, "shifts"),
    default=None,
    metavar="N",
    help="Without MODEL: sideways views of each place, an odd number, each with its own neurons (default: 1).",
)
@click.option(
    "--picture", type=PATH, default=None, metavar="FILE.svg", help="With MODEL: draw the chips and what cores hold."
)
@json_option("the figures")
def fit(
    model: Path | None,
    target: str,
    weight_bits: int | None,
    input_mode: str | None,
    dense_rows: bool,
    neurons_per_place: float | None,
    views: int | None,
    picture: Path | None,
    json_path: Path | None,
) -> list[Table]:
    """Report whether MODEL fits a board, and what each core holds; without MODEL, the largest map that fits."""
    without = "is for fit without MODEL; a model has its neurons"
    for wrong, why in (
        (model and neurons_per_place is not None, f"--neurons-per-place {without}"),
        (model and views is not None, f"--views {without}"),
        (not model and picture, "--picture draws the cores of a model; give MODEL"),
        (
            not model and dense_rows,
            "--dense-rows is for a MODEL; without one, the table has rows for both ways of storing",
        ),
    ):
        if wrong:
            raise click.UsageError(why)
    Outputs((json_path, picture), model=model)
    board = BOARDS[target]
    check_dense_rows(board, dense_rows)
    if model is None:
        return _largest(board, weight_bits, input_mode, neurons_per_place, views or 1, json_path)
    from lava_vpr.deploy.bundle.compression import Changes

    changes = Changes(weight_bits=weight_bits, input_mode=input_mode)
    found = lif_model(open_model(model), board.title, model, direct=True)
    if not found.network.direct:
        return _model(board, found, changes, dense_rows, picture, json_path)
    check_as_learned(model, {"--dense-rows": dense_rows, "--picture": picture, **changes._asdict()})
    return _direct(board, found, json_path)


def _model(
    board: Board,
    model: IntegerModel,
    changes: Changes,
    dense_rows: bool,
    picture: Path | None,
    json_path: Path | None,
) -> list[Table]:
    """What each core of the board holds of a model."""
    from lava_vpr.deploy.bundle.compression import adapted
    from lava_vpr.deploy.bundle.deployment import mapping, modelled, plan_of, unproven
    from lava_vpr.deploy.cost.expected import timed

    with stage(f"placing {model.neurons:,} neurons"):
        compressed = adapted(model, board, changes)
        plan = timed(plan_of(compressed.model, board, dense_rows=dense_rows), compressed.model)
    rows = unproven(plan)
    tables, before = _front_end(model.config.encoder, board, len(plan.cores))
    said = [*placed(plan, compressed.notes, rows, short=True), *tables]
    files: dict[Path | None, str | dict[str, Any]] = {
        json_path: {
            "target": board.name,
            "fits": True if board.memory.public else None,
            "places": model.places,
            "neurons": model.neurons,
            "weight_bits": compressed.model.weight_bits,
            "mapping": mapping(plan),
            "unproven": [row.name for row in rows],
            "modelled": modelled(plan),
            **before,
        }
    }
    if picture is not None:
        from lava_vpr.deploy.show.drawing import draw  # matplotlib takes a second to import

        files[picture] = draw(plan).decode()
        said.append(f"picture: {shown(picture)}")
    return show_results(said, files)


def _direct(board: Board, model: IntegerModel, json_path: Path | None) -> list[Table]:
    """What each population takes of the board where neurons hear the cells of the front end themselves."""
    from lava_vpr.deploy.bundle.direct import unproven
    from lava_vpr.deploy.bundle.front_end import whole_of
    from lava_vpr.deploy.mapping.front_end import placed as placed_front_end
    from lava_vpr.deploy.show.tables import front_end_table

    spec = whole_of(model, counted=board.counters)
    with stage(f"placing {sum(spec.populations.values()):,} neurons"):
        found = placed_front_end(spec, board)
    rows = unproven(spec, board)
    values = {
        "target": board.name,
        "fits": found.as_json(0)["fits"],
        "places": model.places,
        "neurons": model.neurons,
        "weight_bits": model.weight_bits,
        "front_end": found.as_json(0),
        "unproven": [row.name for row in rows],
    }
    return show_results([front_end_table(found, 0), rests_on(rows)], {json_path: values})


def _front_end(encoder: EncoderConfig, board: Board, cores: int) -> tuple[list[Table], dict[str, Any]]:
    """Whether a spiking front end fits beside the network's ``cores``, for people and as JSON; nothing without."""
    if encoder.front_end is None:
        return [], {}
    from lava_vpr.deploy.bundle.front_end import barred
    from lava_vpr.deploy.bundle.targets import TARGETS
    from lava_vpr.deploy.mapping.front_end import placed as placed_front_end
    from lava_vpr.deploy.show.tables import front_end_table

    with stage("placing the spiking front end"):
        found = placed_front_end(encoder.front_end, board)
    left_out = barred(encoder.front_end, board, holds=TARGETS[board.name].holds_front_end)
    return [front_end_table(found, cores, left_out)], {"front_end": found.as_json(cores)}


def _largest(
    board: Board,
    weight_bits: int | None,
    input_mode: str | None,
    neurons_per_place: float | None,
    views: int,
    json_path: Path | None,
) -> list[Table]:
    """The largest maps that fit the board."""
    from lava_vpr.deploy.mapping import largest_map

    mode = input_mode or board.input_mode
    chosen = {"weight_bits": weight_bits, "input_mode": mode, "neurons_per_place": neurons_per_place}
    changes = {name: value for name, value in chosen.items() if value is not None}
    config = update(preset("loihi"), {"network": changes, "views": {"shifts": views}})
    searches = len(largest_map.cases(config, board, weight_bits))
    with progress_bar("looking for the largest maps", searches) as advance:
        rows = largest_map.table(config, board, weight_bits, lambda found: advance(1, found))
    values = [asdict(row) | {"proven": row.proven, "at_most": not board.memory.public} for row in rows]
    return show_results(
        [*_in_words(board, rows), _capacities(board, rows, views)],
        {json_path: {"target": board.name, "views": views, "largest": values}},
    )


def _in_words(board: Board, rows: tuple[Capacity, ...]) -> list[str]:
    """The largest map of those that rest on public sources alone, in a sentence, if there is one."""
    proven = [row for row in rows if row.proven and row.weights == "typical"]
    if not proven:
        return []
    most = max(proven, key=lambda row: row.places)
    return [
        f"{most.places:,} places fit {board.title} by public sources alone, with weights of {most.weight_bits} bits."
    ]


def _capacities(board: Board, rows: tuple[Capacity, ...], views: int) -> Table:
    """The table of the largest maps: for each width of weights and way of counting rows, two networks."""
    notes = (
        "places: with as many weights as real networks have; if every one: every input has a weight to every neuron",
        "sparse: each weight with its index, as public sources count; dense: also rows without indices; no public "
        "source shows these, or weights of fewer than 8 bits with their sign, on a board (both unproven)",
        "the share of weights that are not 0, neurons, and what binds: --json FILE",
    )
    seen = f", each place in {views} views" if views > 1 else ""
    unknown = not board.memory.public
    title = f"no larger maps can fit {board.title}" if unknown else f"the largest maps that fit {board.title}"
    least, most = (" at least", " at most") if unknown else ("", "")
    if unknown:
        notes = (f"{board.known} Whether maps of these sizes fit is unknown.", notes[0], notes[-1])
    names = (f"places{most}", f"neurons{most}", f"cores{least}")
    every = {(row.weight_bits, row.rows): row.places for row in rows if row.weights == "every"}
    cells = []
    for row in rows:
        if row.weights == "typical":
            sizes = (f"{value:,}" for value in (row.places, row.neurons, row.cores, every[row.weight_bits, row.rows]))
            kind = row.rows if row.proven or unknown else f"{row.rows} (unproven)"
            cells.append((f"{row.weight_bits}", kind, f"{100 * row.share:.0f} %", *sizes, row.limit))
    return Table(
        ("bits a weight", "rows", "weights", *names, "if every one", "what binds: one place more"),
        cells,
        notes,
        f"{title}{seen}",
        words=0,
        long=frozenset({1, 7}),
        widest=50,
        aside_columns=frozenset({2, 4, 7}),
    )
