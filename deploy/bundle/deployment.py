"""Deployment of a model as a bundle: partition, registers, host tables, and all other files of the folder."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lava_vpr.cluster.tasks import Pool
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.deploy.bundle.direct import direct_contents
from lava_vpr.deploy.bundle.folder import ReadBundle, json_bytes
from lava_vpr.deploy.bundle.front_end import FRONT_END, front_end_files
from lava_vpr.deploy.bundle.gains import FACTS, facts, gain_files
from lava_vpr.deploy.bundle.readme import readme
from lava_vpr.deploy.bundle.references import described, reference_files
from lava_vpr.deploy.bundle.targets import TARGETS, program_files
from lava_vpr.deploy.cost.expected import timed
from lava_vpr.deploy.hardware.belief import BIAS_INPUT, DENSE, LEARNING, LONG, NARROW, HardwareBelief
from lava_vpr.deploy.hardware.loihi_2 import RESET_SHOWN
from lava_vpr.deploy.hardware.table import relied_on
from lava_vpr.deploy.mapping.front_end import PlacedFrontEnd
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import ConfigError
from lava_vpr.loihi import WEIGHT_BITS
from lava_vpr.model import Model, checked_content, integer_model
from lava_vpr.season.table import GainTable
from lava_vpr.training.measuring import expected_rates, reference_responses


@dataclass(frozen=True)
class Deployed:
    """A written bundle and its plan; of neurons that hear the cells of a front end, where all populations stand."""

    bundle: ReadBundle
    placed: Plan | PlacedFrontEnd

    @property
    def plan(self) -> Plan:
        """The plan.

        Raises:
            ConfigError: the neurons hear the cells of a front end.
        """
        if not isinstance(self.placed, Plan):
            raise ConfigError("neurons that hear the cells of a front end have no plan of their own")
        return self.placed


def plan_of(model: Model, board: Board, *, dense_rows: bool = False) -> Plan:
    """The plan of ``model`` on ``board``: the assignment of its neurons to cores.

    Args:
        model: The model.
        board: The board.
        dense_rows: Whether rows of inputs may be stored dense, without indices, which no public source shows.
    Raises:
        ConfigError: the model is no integer network.
        NetworkLimitError: it does not fit; the message names resource, need, limit and remedy.
    """
    network = integer_model(model, board.title).network
    return partition(network, board, expected_rates(model), dense_rows=dense_rows)


def contents(
    model: Model,
    board: Board,
    *,
    learning: bool = False,
    compression: dict[str, Any] | None = None,
    picture: bool = True,
    measured: bool = False,
    dense_rows: bool = False,
    gains: GainTable | None = None,
) -> tuple[dict[str, Any], dict[str, bytes], Plan | PlacedFrontEnd]:
    """Manifest (for `deploy.bundle.folder.sealed`), files and plan of the bundle of ``model``; see `deploy`."""
    if model.config.encoder.direct is not None:
        target = TARGETS[board.name]
        own = integer_model(model, board.title)
        return direct_contents(own, board, program_files(target.program), target.pixels)
    plan, target = timed(plan_of(model, board, dense_rows=dense_rows), model), TARGETS[board.name]
    if not measured:
        responses = reference_responses(plan.network, model.activity, model.places, model.config, Pool(cores()))
        calibration = model.calibration if np.array_equal(responses, model.responses) else None
        model = replace(model, responses=responses, calibration=calibration)
    files = {**reference_files(model), **target.network_files(plan), **program_files(target.program)}
    if learning:
        from lava_vpr.deploy.bundle.learning import learning_files

        files |= learning_files(model)
    manifest = _manifest(model, plan, compression)
    if gains is not None:
        files |= gain_files(gains, model)
        manifest[FACTS] = facts(gains, model)
    taken = [(core.chip, core.core) for core in plan.cores]
    front_end, said = front_end_files(model.config.encoder.front_end, board, taken, holds=target.holds_front_end)
    files |= front_end
    if said is not None:
        manifest[FRONT_END] = said
    files["mapping.json"] = json_bytes(mapping(plan))
    has = {"learning": learning, "gained": gains is not None}
    rows = unproven(plan, learning=learning)
    files["README.md"] = readme(model, plan, target.guide, target.parts, rows, **has, front_end=said)
    if picture:
        from lava_vpr.deploy.show.drawing import draw  # matplotlib takes a second to import

        files["mapping.svg"] = draw(plan)
    return manifest | {"unproven": [row.name for row in rows]}, files, plan


def unproven(plan: Plan, *, learning: bool = False) -> tuple[HardwareBelief, ...]:
    """Every row of docs/hardware.md without a public source that the bundle of ``plan`` rests on. What options of its
    host program need besides, ``--power`` and biases that queries bring, is left out.

    Args:
        plan: The plan of the network.
        learning: Whether the bundle also holds the network that learns.
    """
    chip = plan.board.chip
    has = {
        BIAS_INPUT: plan.network.bias_input,
        DENSE: any(core.dense_inputs.any() for core in plan.cores),
        LEARNING: learning,
        LONG: plan.network.interval > RESET_SHOWN,
        NARROW: plan.weight_bits < WEIGHT_BITS,
    }
    return relied_on({chip, *(f"{chip}: {name}" for name, there in has.items() if there)})


def deploy(
    model: Model,
    board: Board,
    path: Path,
    *,
    learning: bool = False,
    compression: dict[str, Any] | None = None,
    picture: bool = True,
    measured: bool = False,
    dense_rows: bool = False,
    gains: GainTable | None = None,
) -> Deployed:
    """Write the bundle of ``model`` for ``board``.

    Args:
        model: The model as it is to run (compressed, with its input mode).
        board: From `lava_vpr.deploy.boards.board`.
        path: The folder; a bundle that stands there is replaced in one step.
        learning: Also hold the network that learns (Loihi 2).
        compression: What compression did, for the manifest.
        picture: Also draw where the neurons stand.
        measured: The responses of ``model`` are those of its network; otherwise they are measured.
        dense_rows: See `plan_of`.
        gains: What a drive's queries were presented with, for the host program to present them so; None: nothing.
    Raises:
        ConfigError: the model is no integer network, or ``gains`` are of another.
        NetworkLimitError: it does not fit the board.
        ModelFileError: its bundle could not be opened again.
        BundleError: the folder cannot be written.
    """
    bundle_folder.check_replaceable(path)
    checked_content(integer_model(model, board.title), network=False)
    manifest, files, plan = contents(
        model,
        board,
        learning=learning,
        compression=compression,
        picture=picture,
        measured=measured,
        dense_rows=dense_rows,
        gains=gains,
    )
    return Deployed(bundle_folder.write(path, manifest, files), plan)


def _manifest(model: Model, plan: Plan, compression: dict[str, Any] | None) -> dict[str, Any]:
    """The manifest of the bundle of ``model``, without the list of its files."""
    network, board = plan.network, plan.board
    return described(model, network, board) | {
        "input": {
            "mode": "bias" if network.bias_input else "injected",
            "trains": "regular" if network.regular else "poisson",
            "host_spikes_per_step": round(plan.host_spikes, 3),
        },
        "clearing": board.clearing.of(network),
        "compression": compression,
        "modelled": modelled(plan),
    }


def modelled(plan: Plan) -> dict[str, Any] | None:
    """The modelled times as JSON; None where the board's are not public."""
    return None if plan.times is None else plan.times.as_json()


def mapping(plan: Plan) -> dict[str, Any]:
    """What each core holds, needs and is expected to do in a step with input, and its mean modelled time, as JSON."""
    rows = []
    for core in plan.cores:
        load: dict[str, Any] = {name: round(value, 6) for name, value in asdict(core.load).items() if name != "busy"}
        load["nanoseconds"] = "unknown" if core.microseconds is None else round(1e3 * core.microseconds, 6)
        needs = {name: "unknown" if value is None else value for name, value in asdict(core.needs).items()}
        rows.append(
            {
                "chip": core.chip,
                "core": core.core,
                "parts": [asdict(part) for part in core.parts],
                "dense_input_rows": int(core.dense_inputs.sum()),
                "needs": needs,
                "load": load,
            }
        )
    return {
        "weight_bits": plan.weight_bits,
        "inhibition_bits": plan.inhibition_bits,
        "hops_per_step": "unknown" if plan.hops is None else round(plan.hops, 6),
        "cores": rows,
    }
