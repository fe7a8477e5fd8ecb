"""What cores need of Loihi 1, as we plan it and as nengo-loihi's own code counts it.

    python -m benchmarks.oracles.needs [--random N] [--no-real]      (`make oracles` sets it up)

Every core of every plan is described by the neurons on it and the weights that lead to them, nothing that we counted.
nengo-loihi (1.1.0, in an environment of its own) builds its own block of it and counts synapse bits, axons, formats,
decays and thresholds with the functions that it uses before it writes a board, and validates the core. Everything must
be equal. One difference is known and subtracted here: nengo-loihi reads spikes out by looking at compartments, we send
them to the embedded processor, which takes one output axon for each excitatory neuron.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import learn
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.plan import CorePlan, Plan
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.deploy.registers.core_images import core_images
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import InputError, NetworkLimitError
from lava_vpr.isolated.child import run_child
from lava_vpr.loihi import WORD_BITS
from lava_vpr.model import integer_model
from lava_vpr.training.references import expected_rates

ROOT = Path(__file__).resolve().parents[2]
PYTHON = ROOT / ".venv-nengo-loihi" / "bin" / "python"
SCRIPT = Path(__file__).with_name("needs_in_nengo_loihi.py")
COUNTED = ("compartments", "axons_in", "axons_out", "synapse_bits", "profiles", "thresholds", "formats")
console = Console(highlight=False, width=118)


def problem(plan: Plan, core: CorePlan, registers: dict[str, Any], compartments: NDArray[np.int32]) -> dict[str, Any]:
    """A core as the oracle takes it; formats and compartments' registers are those of its image."""
    network, exc, inh, inputs = plan.network, core.part("exc"), core.part("inh"), core.part("inputs")
    columns = slice(exc.first, exc.first + exc.size)
    targets = [other.part("exc") for other in plan.cores if other.part("exc").size]
    out = [exc.size]  # to their relays
    if network.lateral:
        out += [inh.size for target in targets if target.size > 1 or inh_elsewhere(inh.first, inh.size, target)]
    used = [network.weights[inputs.first : inputs.first + inputs.size, t.first : t.first + t.size] for t in targets]
    out += [int(weights.any(axis=1).sum()) for weights in used if inputs.size]
    spare, lateral = 8 - plan.weight_bits, 8 - plan.lateral_bits
    profiles = registers["cxProfileCfg"]
    return {
        "weights": network.weights[:, columns],
        "dense": core.dense_inputs,
        "bits": plan.weight_bits,
        "exponent": -spare,
        "inhibition": network.lateral and network.inhibition,
        "lateral_bits": plan.lateral_bits,
        "lateral_exponent": network.inhibition_exponent - lateral,
        "own": exc.size,
        "elsewhere": network.neurons - exc.size,
        "dense_lateral": core.dense_lateral,
        "relays": inh.size,
        "relay_bits": 2,
        "relay_exponent": -6,
        "compartments": len(compartments),
        "decay_u": np.array([profiles[i]["decayU"] for i in compartments[:, 0]], np.int32),
        "decay_v": np.array([profiles[i]["decayV"] for i in compartments[:, 0]], np.int32),
        "threshold": np.array([registers["vthProfileCfg"][i]["vth"] for i in compartments[:, 1]], np.int32),
        "axons_out": np.array(out, np.int64),
    }


def inh_elsewhere(first: int, size: int, target: Any) -> bool:
    """Whether any of these relays inhibits a single neuron ``target`` that is not its own."""
    return bool(set(range(first, first + size)) - {target.first})


def planned(core: CorePlan) -> dict[str, int | None]:
    """Our own count, without what nengo-loihi does not have."""
    needs = core.needs
    return {
        "compartments": needs.compartments,
        "axons_in": needs.axons_in,
        "axons_out": None if needs.axons_out is None else needs.axons_out - core.part("exc").size,
        "synapse_bits": None if needs.synapse_words is None else needs.synapse_words * WORD_BITS,
        "profiles": needs.profiles,
        "thresholds": needs.thresholds,
        "formats": needs.formats,
    }


def ask(problems: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What nengo-loihi says of each core.

    Raises:
        InputError: its environment is missing, or it failed.
    """
    if not PYTHON.exists():
        raise InputError(f"{PYTHON}: no environment of nengo-loihi; run `make oracles`")
    with tempfile.TemporaryDirectory() as folder:
        for number, arrays in enumerate(problems):
            np.savez(Path(folder) / f"{number:05d}.core.npz", **arrays)
        ended = run_child([PYTHON, SCRIPT, folder], seconds=1200)
        if ended.code:
            raise InputError(f"{SCRIPT.name}: failed; {ended.last}")
        return [json.loads(path.read_text()) for path in sorted(Path(folder).glob("*.needs.json"))]


def problems(plan: Plan) -> list[dict[str, Any]]:
    """Every core of a plan as the oracle takes it."""
    pairs = zip(plan.cores, core_images(plan), strict=True)
    return [problem(plan, core, image.registers, image.compartments) for core, image in pairs]


def differences(core: CorePlan, theirs: dict[str, Any]) -> list[str]:
    """The counts of a core that differ, or why nengo-loihi refuses it."""
    where, ours = f"chip {core.chip} core {core.core}", planned(core)
    refusals = [f"{where}: refused by nengo-loihi: {theirs['error']}"] if theirs["error"] else []
    wrong = [name for name in COUNTED if ours[name] != theirs.get(name)]
    return refusals + [f"{where}: {name} {ours[name]}, nengo-loihi {theirs.get(name)}" for name in wrong]


def random_network(seed: int) -> FixedNetwork:
    """A network of any size, density and width that may fit Kapoho Bay."""
    rng = np.random.default_rng(seed)
    inputs, neurons = int(rng.integers(1, 1600)), int(rng.integers(1, 400))
    bits = int(rng.choice([1, 2, 3, 4, 5, 6, 7, 8]))
    density = rng.choice([0.05, 0.3, 0.6, 1.0])
    weights = rng.integers(1, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < density)
    weights = (weights * np.minimum(1, 30_000 / np.maximum(1, weights.sum(axis=0)))).astype(np.uint8)
    inhibition = int(rng.integers(0, max(1, min(255, 32_000 // max(1, neurons - 1)))))
    return FixedNetwork(weights, bits, 0, int(rng.integers(1, 5000)), inhibition, 0, 137, 50, int(rng.integers(0, 2)))


def random_plans(count: int) -> Iterator[Plan]:
    """Plans of random networks that fit."""
    for seed in range(count):
        network = random_network(seed)
        rates = np.full(network.inputs, min(20.0 / network.inputs, 1.0))
        try:
            yield partition(network, KAPOHO_BAY, rates)
        except NetworkLimitError as error:
            console.print(f"random {seed}: does not fit ({error})", markup=False)


def real_plans() -> Iterator[tuple[str, Plan]]:
    """The default model of 100 and of 500 places, with other widths and in both input modes."""
    for places in ((0, 100), (0, 500)):
        model = integer_model(learn(places, preset("loihi")), "Kapoho Bay")
        for bias_input in (False, True):
            name = f"{places[1]} places, 3 bits, {'bias' if bias_input else 'injected'}"
            yield name, partition(replace(model.network, bias_input=bias_input), KAPOHO_BAY, expected_rates(model))
    config = update(preset("loihi"), {"network": {"weight_bits": 1}})
    narrow = integer_model(learn((0, 100), config), "Kapoho Bay")
    yield "100 places, 1 bit, injected", partition(narrow.network, KAPOHO_BAY, expected_rates(narrow))


def too_large() -> dict[str, Any]:
    """The core of 100 neurons, 784 + 400 input axons and 8 bits that does not fit, as a known figure."""
    return {
        "weights": np.full((1184, 100), 200),
        "dense": np.ones(1184, bool),
        **{"bits": 8, "exponent": 0, "inhibition": 0, "lateral_bits": 8, "lateral_exponent": 0, "own": 0},
        **{"elsewhere": 0, "dense_lateral": True, "relays": 0, "relay_bits": 2, "relay_exponent": -6},
        "compartments": 100,
        **{name: np.full(100, 100, np.int32) for name in ("decay_u", "decay_v", "threshold")},
        "axons_out": np.zeros(0, np.int64),
    }


@click.command()
@click.option("--random", "count", default=40, show_default=True, help="Random networks.")
@click.option("--real/--no-real", default=True, help="Also networks trained on real images (LAVA_VPR_DATA).")
def main(count: int, real: bool) -> None:
    """Print what was compared; fail if anything differs."""
    table = Table(title="needs of cores, ours and nengo-loihi's", title_justify="left")
    for i, name in enumerate(("", "cores", "counts compared", "differ", "most bits of a core")):
        table.add_column(name, justify="right" if i else "left")
    failed: list[str] = []
    plans = [("random", plan) for plan in random_plans(count)] + (list(real_plans()) if real else [])
    cores = [(name, core, made) for name, plan in plans for core, made in zip(plan.cores, problems(plan), strict=True)]
    *answers, refused = ask([made for _, _, made in cores] + [too_large()])
    for name in dict.fromkeys(name for name, _ in plans):
        pairs = [(core, theirs) for (label, core, _), theirs in zip(cores, answers, strict=True) if label == name]
        wrong = [line for core, theirs in pairs for line in differences(core, theirs)]
        failed += [f"{name}: {line}" for line in wrong]
        most = max((core.needs.synapse_words or 0) * WORD_BITS for core, _ in pairs)
        figures = (len(pairs), len(pairs) * len(COUNTED), len(wrong), most)
        table.add_row(name, *(f"{figure:,}" for figure in figures))
    console.print(table)
    refusal = refused["error"] or "nothing"
    console.print(f"a core that is too large: nengo-loihi says {refusal!r}", markup=False)
    if "exceeded max (1048576)" not in refusal:
        failed.append("a core that is too large was not refused")
    for line in failed[:20]:
        console.print(line, markup=False)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
