"""``lava-vpr deploy``."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import click

from lava_vpr.backends.opening import open_model
from lava_vpr.cli.choose import open_queries
from lava_vpr.cli.common import (
    PATH,
    Number,
    RegisteredName,
    check_dense_rows,
    console,
    dense_rows_option,
    encode_queries,
    every_option,
    places_option,
    print_unproven,
    print_whole,
    progress_bar,
    setting_type,
    stage,
    stderr,
)
from lava_vpr.cli.outputs import Outputs, write_json
from lava_vpr.config import INPUT_MODES, LifNetwork
from lava_vpr.deploy.boards.board import BOARDS, Board
from lava_vpr.deploy.bundle.deployment import Deployed, unproven
from lava_vpr.deploy.bundle.deployment import deploy as write_bundle
from lava_vpr.deploy.bundle.folder import check_replaceable
from lava_vpr.deploy.bundle.targets import TARGETS
from lava_vpr.deploy.compression.compression import Changes, Compressed, Figures, for_board
from lava_vpr.deploy.show.tables import core_table, summary
from lava_vpr.engine.threads import cores
from lava_vpr.experiments.calibration import Calibration, calibrated, figures, search
from lava_vpr.model import Model, integer_model
from lava_vpr.show.numbers import percent
from lava_vpr.show.table import Table
from lava_vpr.storage.text import shown
from lava_vpr.truth.alignment import aligned_truth


@click.command()
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.option("--target", type=RegisteredName(BOARDS), required=True, help="Board to run on.")
@click.option("-o", "--output", required=True, type=PATH, metavar="BUNDLE", help="Folder to write.")
@click.option(
    "--weight-bits",
    type=setting_type(LifNetwork, "weight_bits"),
    default=None,
    help="Bits of one weight (default: the model's, or the most that fit).",
)
@click.option(
    "--prune",
    type=Number(0, 1, max_open=True),
    default=None,
    metavar="P",
    help="Share of each neuron's weights to set to 0, smallest first (default: none).",
)
@click.option("--calibrate", type=str, default=None, metavar="QUERY", help="Images to compare recall before and after.")
@click.option(
    "--max-loss",
    type=Number(0, 1),
    default=None,
    metavar="X",
    help="Find the cheapest weights that lose at most this much R@1, a fraction, on the --calibrate images.",
)
@places_option("Images A..B-1 of --calibrate (default: the model's own range).")
@every_option
@click.option(
    "--input-mode",
    type=click.Choice(INPUT_MODES),
    default=None,
    help="The host injects inputs' spikes, or inputs integrate a bias (default: the model's; on Loihi 2: bias).",
)
@dense_rows_option
@click.option(
    "--learning",
    is_flag=True,
    help="Loihi 2: add the network that learns; with --calibrate, also train it and print its recall.",
)
@click.option("--json", "json_path", type=PATH, default=None, metavar="FILE", help="Write the figures as JSON.")
def deploy(
    model_path: Path,
    target: str,
    output: Path,
    weight_bits: int | None,
    prune: float | None,
    calibrate: str | None,
    max_loss: float | None,
    places: tuple[int, int] | None,
    every: float,
    input_mode: str | None,
    dense_rows: bool,
    learning: bool,
    json_path: Path | None,
) -> None:
    """Place the neurons of MODEL on a board's cores, and write all that the board needs as the folder BUNDLE.

    Weights are quantised anew from those that were learned where bits, pruning or the input mode change, or where the
    board demands it. With --max-loss, ways to do so are tried from cheap to dear, by synaptic operations of a query.
    """
    board = BOARDS[target]
    _check_usage(board, calibrate, max_loss, places, learning)
    check_dense_rows(board, dense_rows)
    check_replaceable(output)
    images = () if calibrate is None else (calibrate,)
    outputs = Outputs((json_path,), folders=(output,), model=model_path, images=images)
    model = open_model(model_path)
    integer_model(model, board.title, model_path)
    calibration = None
    if calibrate is not None:
        calibration = _calibration(model, calibrate, places, every, outputs)
    compressed = _compressed(model, board, Changes(weight_bits, prune, input_mode), calibration, max_loss)
    with stage(f"placing {compressed.model.neurons:,} neurons, and writing the bundle"):
        deployed = write_bundle(
            compressed.model,
            board,
            output,
            learning=learning,
            compression=compressed.as_json(),
            measured=not compressed.unchanged,
            dense_rows=dense_rows,
        )
    learned = _learned(deployed, model, calibration) if learning and calibration is not None else None
    if json_path is not None:  # files first: whoever reads the table may go away
        values = {
            "places": model.places,
            "neurons": model.neurons,
            "weight_bits": compressed.model.weight_bits,
            "cores": len(deployed.plan.cores),
            "compression": compressed.as_json(),
            "learning": asdict(learned) if learned is not None else None,
            "unproven": deployed.bundle.manifest["unproven"],
            "modelled": deployed.bundle.manifest["modelled"],
        }
        write_json(json_path, {"target": board.name, **values})
    for note in compressed.notes:
        stderr.print(f"note: {note}")
    if compressed.before is not None:
        print_whole(_figures(compressed, learned))
    print_whole(core_table(deployed.plan))
    console.print("\n".join(summary(deployed.plan)))
    print_unproven(unproven(deployed.plan, learning=learning))
    console.print(f"bundle: {shown(output)}")


def _check_usage(
    board: Board, calibrate: str | None, max_loss: float | None, places: tuple[int, int] | None, learning: bool
) -> None:
    """Refuse options that contradict each other."""
    if max_loss is not None and calibrate is None:
        raise click.UsageError("--max-loss needs --calibrate QUERY: images to measure the loss on")
    if places is not None and calibrate is None:
        raise click.UsageError("--places chooses among the images of --calibrate QUERY; give it, too")
    if learning and not TARGETS[board.name].learns:
        able = " or ".join(name for name, row in TARGETS.items() if row.learns)
        raise click.UsageError(
            f"--learning needs --target {able}: the network that learns is wired from Lava's library, which does not "
            "run on Loihi 1"
        )


def _calibration(
    model: Model, source: str, places: tuple[int, int] | None, every: float, outputs: Outputs
) -> Calibration:
    """The calibration images and which place each shows."""
    traverse = open_queries(model, source, places, every, outputs=outputs)
    return encode_queries(traverse, model)[0], aligned_truth(model, traverse)


def _compressed(
    model: Model, board: Board, changes: Changes, calibration: Calibration | None, max_loss: float | None
) -> Compressed:
    """The model as it is to be deployed."""
    if calibration is None or max_loss is None:
        with stage("measuring the network for the board"):
            compressed = for_board(model, board, changes, threads=cores())
            return compressed if calibration is None else calibrated(compressed, calibration, threads=cores())
    with ExitStack() as bars:
        return search(
            model, board, calibration, max_loss, changes, threads=cores(), begin=lambda points: _told(bars, points)
        )


def _told(bars: ExitStack, points: int) -> Callable[[str], None]:
    """Show a bar for a search of at most ``points``; what is returned moves it by one."""
    advance = bars.enter_context(progress_bar("compressing", points))
    return lambda note: advance(1, note)


def _learned(deployed: Deployed, model: Model, calibration: Calibration) -> Figures:
    """What the bundle's network that learns reaches, trained from the bundle's own files."""
    from lava_vpr.deploy.bundle.learning import learned_on_chip, read_learning

    with progress_bar("learning as on the chip", 1):
        return figures(learned_on_chip(model, read_learning(deployed.bundle), cores()), calibration, threads=cores())


def _figures(compressed: Compressed, learned: Figures | None) -> Table:
    """The model before, all that was tried, what was chosen, and what the chip learns."""
    model, original = compressed.model, compressed.original
    chosen = (model.weight_bits, compressed.prune)
    rows = []
    if compressed.before is not None:
        rows.append(_row("the model's", original.weight_bits, 0.0, compressed.before))
    for point, result in compressed.tried:
        if (point.weight_bits, point.prune) != chosen:
            rows.append(_row("tried", point.weight_bits, point.prune, result))
    strong = frozenset({len(rows)}) if compressed.after is not None else frozenset()
    if compressed.after is not None:
        rows.append(_row("deployed", *chosen, compressed.after))
    if learned is not None:
        rows.append(_row("learned on the chip", original.weight_bits, 0.0, learned))
    columns = ("weights", "bits", "pruned %", "R@1", "R@100P", "AUC", "operations a query")
    return Table(columns, rows, title="on the calibration images", strong=strong)


def _row(name: str, bits: int | None, prune: float, figures: Figures) -> tuple[str, ...]:
    shares = (prune, figures.recall_at_1, figures.recall_at_100_precision, figures.auc)
    return (name, f"{bits}", *map(percent, shares), f"{figures.operations:,.0f}")
