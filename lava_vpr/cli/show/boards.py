"""What `fit` and `deploy` share: options of a board, and what they print of a plan."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lava_vpr.cli.common import RegisteredName, setting_type, stderr
from lava_vpr.config import INPUT_MODES, LifNetwork
from lava_vpr.deploy.boards.board import BOARDS, Board
from lava_vpr.deploy.hardware.belief import HardwareBelief
from lava_vpr.errors import ConfigError
from lava_vpr.show.table import Table

if TYPE_CHECKING:
    from lava_vpr.deploy.boards.plan import Plan

target_option = click.option("--target", type=RegisteredName(BOARDS), required=True, help="Board to run on.")
weight_bits_option = click.option(
    "--weight-bits",
    type=setting_type(LifNetwork, "weight_bits"),
    default=None,
    help="Bits of one weight (default: the model's, or the most that fit).",
)
input_mode_option = click.option(
    "--input-mode",
    type=click.Choice(INPUT_MODES),
    default=None,
    help="The host injects inputs' spikes, or inputs integrate a bias (default: the model's; on Loihi 2: bias).",
)


dense_rows_option = click.option(
    "--dense-rows",
    is_flag=True,
    help="Kapoho Bay: store rows without indices where that saves memory, which no public source shows (unproven).",
)


def check_dense_rows(board: Board, dense_rows: bool) -> None:
    """Refuse ``--dense-rows`` for a board whose way of storing rows is not ours to choose."""
    if dense_rows and not board.memory.public:
        able = " or ".join(name for name, row in BOARDS.items() if row.memory.public)
        raise click.UsageError(f"--dense-rows needs --target {able}: how {board.title} stores rows is not public")


def placed(
    plan: Plan, notes: Iterable[str], beliefs: Sequence[HardwareBelief], *, short: bool = False
) -> list[Table | str]:
    """Where neurons stand, and what that rests on, for the terminal.

    Args:
        plan: Where they stand.
        notes: What was changed for the board; printed on stderr.
        beliefs: Unproven beliefs that it rests on; those are named that not all bundles for its board have.
        short: Whether two sentences are to do for a network of few cores.
    """
    from lava_vpr.deploy.show.tables import core_table, in_short, summary, told_in_short

    for note in notes:
        stderr.print(f"note: {note}")
    (cores, *others), fits = summary(plan), "It fits" if plan.board.memory.public else "It may fit"
    verdict = f"{fits} {plan.board.title}: {cores[0].lower()}{cores[1:]}"
    told = [in_short(plan, len(beliefs))] if short and told_in_short(plan) else ["\n".join(others), rests_on(beliefs)]
    return [verdict, core_table(plan), *told]


def rests_on(beliefs: Collection[HardwareBelief]) -> str:
    """A sentence about the unproven rows of docs/hardware.md that a bundle rests on."""
    own = [row.name for row in beliefs if all(":" in each for each in row.rests)]
    return (
        f"Rests on {len(beliefs)} beliefs that no public source shows (docs/hardware.md): {len(beliefs) - len(own)} of "
        f"every bundle for this board{''.join(f'; {name}' for name in own)}."
    )


def check_as_learned(path: Path, given: Mapping[str, Any]) -> None:
    """Refuse options for a network that hears the cells of the front end, which is placed as it was learned.

    Args:
        path: The model.
        given: Values by option, or by the name of a change.
    Raises:
        ConfigError: one is given.
    """
    name = next((name for name, value in given.items() if value not in (None, False)), None)
    if name is not None:
        option = name if name.startswith("--") else f"--{name.replace('_', '-')}"
        raise ConfigError(
            f"{path}: {option} is for inputs that have rates, but these neurons hear the cells of the front end "
            f"themselves; leave out {option}, or train with --input frontend"
        )
