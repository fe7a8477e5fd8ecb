"""``lava-vpr deploy``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

from lava_vpr.backends.asking import open_model
from lava_vpr.cli.choose import open_queries
from lava_vpr.cli.common import PATH, Number, encode_queries, noun, one_bar, progress_bar, stage
from lava_vpr.cli.models.season import applied, applied_option
from lava_vpr.cli.nouns import every_option, json_option, places_option
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
from lava_vpr.cli.show.headings import CHANGED, IMAGES, LEARNED, OUTPUT, SEASON, Headed, under
from lava_vpr.deploy.boards.board import BOARDS, Board
from lava_vpr.deploy.bundle.compression import Changes, Compressed, CompressionFigures, for_board
from lava_vpr.deploy.bundle.deployment import Deployed, deploy as write_bundle, unproven
from lava_vpr.deploy.bundle.direct import unproven as direct_unproven
from lava_vpr.deploy.bundle.folder import check_replaceable
from lava_vpr.deploy.bundle.front_end import FRONT_END, held_sentence, whole_of
from lava_vpr.deploy.bundle.targets import TARGETS
from lava_vpr.deploy.mapping.front_end import PlacedFrontEnd
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import shown
from lava_vpr.experiments.calibration import Calibration, calibrated, figures, search
from lava_vpr.model import IntegerModel, Model, integer_model, lif_model
from lava_vpr.season.table import load as load_table
from lava_vpr.show.numbers import percent
from lava_vpr.show.table import Table
from lava_vpr.truth.alignment import aligned_truth


@dataclass(frozen=True)
class CalibrationImages:
    """Images to compare recall on, as the user says.

    Attributes:
        calibrate: Folder, list, video or image; None: recall is not compared.
        max_loss: What R@1 may lose, a fraction, in a search for the cheapest weights; None: no search.
        places: Images A..B-1; None: the model's range.
        every: Seconds between two frames of a video.
    """

    calibrate: str | None
    max_loss: float | None
    places: tuple[int, int] | None
    every: float

    def check(self) -> None:
        """Refuse what says something of images that are not there."""
        if self.max_loss is not None and self.calibrate is None:
            raise click.UsageError("--max-loss needs --calibrate QUERY: images to measure the loss on")
        if self.places is not None and self.calibrate is None:
            raise click.UsageError("--places chooses among the images of --calibrate QUERY; give it, too")

    @property
    def sources(self) -> tuple[str, ...]:
        """The sources to be read."""
        return () if self.calibrate is None else (self.calibrate,)

    def of(self, model: Model, outputs: Outputs) -> Calibration | None:
        """The images, and which place each shows; None: recall is not compared.

        Raises:
            InputError: they cannot be used.
        """
        if self.calibrate is None:
            return None
        traverse = open_queries(model, self.calibrate, self.places, self.every, outputs)
        return encode_queries(traverse, model)[0], aligned_truth(model, traverse)


@click.command(cls=Headed)
@click.argument("model_path", metavar="MODEL", type=PATH)
@under(
    OUTPUT,
    target_option,
    click.option("-o", "--output", required=True, type=PATH, metavar="BUNDLE", help="Folder to write."),
)
@under(
    CHANGED,
    weight_bits_option,
    click.option(
        "--prune",
        type=Number(0, 1, max_open=True),
        default=None,
        metavar="P",
        help="Share of each neuron's weights to set to 0, smallest first (default: none).",
    ),
)
@under(
    IMAGES,
    click.option(
        "--calibrate", type=str, default=None, metavar="QUERY", help="Images to compare recall before and after."
    ),
)
@under(
    CHANGED,
    click.option(
        "--max-loss",
        type=Number(0, 1),
        default=None,
        metavar="X",
        help="Find the cheapest weights that lose at most this much R@1, a fraction, on the --calibrate images.",
    ),
)
@places_option("Images A..B-1 of --calibrate (default: the model's own range).")
@every_option
@under(
    CHANGED,
    input_mode_option,
    dense_rows_option,
)
@applied_option
@under(
    SEASON,
    click.option(
        "--replay",
        type=PATH,
        default=None,
        metavar="FILE",
        help="Add the gains and biases in FILE, written by --gains: BUNDLE's program then presents the same queries "
        "with them.",
    ),
)
@under(
    LEARNED,
    click.option(
        "--learning",
        is_flag=True,
        help="Loihi 2: add the network that learns; with --calibrate, also train it and print its recall.",
    ),
)
@under(
    OUTPUT,
    json_option("the figures"),
)
@noun("changes", Changes)
@noun("images", CalibrationImages)
def deploy(
    model_path: Path,
    target: str,
    output: Path,
    changes: Changes,
    images: CalibrationImages,
    dense_rows: bool,
    season: Path | None,
    replay: Path | None,
    learning: bool,
    json_path: Path | None,
) -> None:
    """Place the neurons of MODEL on a board's cores, and write everything that the board needs into the folder BUNDLE.

    Learned weights are quantised again if bits, pruning or the input mode change, or if the board requires it.
    --max-loss tries the possible combinations in the order of their synaptic operations per query, fewest first.
    """
    board = BOARDS[target]
    images.check()
    _check_learning(board, learning)
    check_dense_rows(board, dense_rows)
    check_replaceable(output)
    outputs = Outputs((json_path,), folders=(output,), read=(season, replay), model=model_path, images=images.sources)
    found = lif_model(open_model(model_path), board.title, model_path, direct=True)
    if found.network.direct:
        others = {"--replay": replay, "--learning": learning, "--dense-rows": dense_rows}
        check_as_learned(model_path, {**changes._asdict(), "--calibrate": images.calibrate, **others})
        return _direct(integer_model(applied(found, season)[0], "deploy"), board, output, json_path)
    model, _ = applied(found, season)
    table = None if replay is None else load_table(replay)
    calibration = images.of(model, outputs)
    compressed = _compressed(model, board, changes, calibration, images.max_loss)
    if table is not None:
        table.check(integer_model(compressed.model, "--replay"))
    deployed = _written(compressed, board, output, dense_rows=dense_rows, learning=learning, gains=table)
    learned = _learned(model, calibration) if learning and calibration is not None else None
    compared = [] if compressed.before is None else [_figures(compressed, learned)]
    said = _placed(deployed, compressed, learning=learning)
    values = _values(model, compressed, deployed, learned)
    show_results([*compared, *said, f"bundle: {shown(output)}"], {json_path: values})


def _placed(deployed: Deployed, compressed: Compressed, *, learning: bool) -> list[Table | str]:
    """Where neurons stand, and what the bundle holds of a spiking front end."""
    said = placed(deployed.plan, compressed.notes, unproven(deployed.plan, learning=learning))
    front_end = deployed.bundle.manifest.get(FRONT_END)
    return said if front_end is None else [*said, held_sentence(front_end)]


def _direct(model: IntegerModel, board: Board, output: Path, json_path: Path | None) -> None:
    """Write the bundle of neurons that hear the cells of the front end themselves."""
    with stage(f"placing pixels to {model.places:,} places, and writing the bundle"):
        deployed = write_bundle(model, board, output)
    manifest = deployed.bundle.manifest
    values = {
        "target": board.name,
        "places": model.places,
        "neurons": model.neurons,
        "weight_bits": model.weight_bits,
        "cores": deployed.placed.cores if isinstance(deployed.placed, PlacedFrontEnd) else None,
        "compression": None,
        "learning": None,
        "unproven": manifest["unproven"],
        "modelled": None,
    }
    rests = rests_on(direct_unproven(whole_of(model), board))
    show_results([held_sentence(manifest[FRONT_END]), rests, f"bundle: {shown(output)}"], {json_path: values})


def _written(compressed: Compressed, board: Board, output: Path, **options: Any) -> Deployed:
    """The bundle of a model, written to the folder ``output``."""
    with stage(f"placing {compressed.model.neurons:,} neurons, and writing the bundle"):
        found, measured = compressed.as_json(), not compressed.unchanged
        return write_bundle(compressed.model, board, output, compression=found, measured=measured, **options)


def _check_learning(board: Board, learning: bool) -> None:
    """Refuse ``--learning`` for a board whose bundles have no network that learns."""
    if learning and not TARGETS[board.name].learns:
        able = " or ".join(name for name, row in TARGETS.items() if row.learns)
        raise click.UsageError(
            f"--learning needs --target {able}: the network that learns is wired from Lava's library, which does not "
            "run on Loihi 1"
        )


def _values(
    model: Model, compressed: Compressed, deployed: Deployed, learned: CompressionFigures | None
) -> dict[str, Any]:
    """The figures as JSON values."""
    manifest = deployed.bundle.manifest
    return {
        "target": deployed.plan.board.name,
        "places": model.places,
        "neurons": model.neurons,
        "weight_bits": compressed.model.weight_bits,
        "cores": len(deployed.plan.cores),
        "compression": compressed.as_json(),
        "learning": asdict(learned) if learned is not None else None,
        "unproven": manifest["unproven"],
        "modelled": manifest["modelled"],
    }


def _compressed(
    model: Model, board: Board, changes: Changes, calibration: Calibration | None, max_loss: float | None
) -> Compressed:
    """The model as it is to be deployed."""
    if calibration is None or max_loss is None:
        with stage("measuring the network for the board"):
            compressed = for_board(model, board, changes, threads=cores())
            return compressed if calibration is None else calibrated(compressed, calibration, threads=cores())
    with one_bar() as show:

        def begin(points: int) -> Callable[[str], None]:
            advance = show("compressing", points)
            return lambda note: advance(1, note)

        return search(model, board, calibration, max_loss, changes, threads=cores(), begin=begin)


def _learned(model: Model, calibration: Calibration) -> CompressionFigures:
    """What the bundle's network that learns reaches, trained as its files say."""
    from lava_vpr.deploy.bundle.learning import learned_on_chip

    with progress_bar("learning as on the chip", 1):
        return figures(learned_on_chip(model, cores()), calibration, threads=cores())


def _figures(compressed: Compressed, learned: CompressionFigures | None) -> Table:
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


def _row(name: str, bits: int | None, prune: float, figures: CompressionFigures) -> tuple[str, ...]:
    shares = (prune, figures.recall_at_1, figures.recall_at_100_precision, figures.auc)
    return (name, f"{bits}", *map(percent, shares), f"{figures.operations:,.0f}")
