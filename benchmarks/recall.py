"""Recall on real images: Nordland, summer learned, winter recognised, exact matches only.

    LAVA_VPR_DATA=... python -m benchmarks.recall [--seeds 0,1,2] [--bits] [--learning] [--inputs] [--input-mode]
        [--preset loihi]

Places 0:200 chose the settings, 200:500 did not: they are printed apart. The paper's decoders are those of its release
(`lava_vpr.matching.equations`); what its printed equations give in this project's reading stands beside. Every row is
the mean over its sections and seeds; each seed draws its own start weights and its own noise in training, in the
references' responses and in queries.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import SECTIONS, answer, encoded, learn, part, required
from benchmarks.results.places import TEMPLATES
from lava_vpr.config import INPUT_MODES, Config, preset
from lava_vpr.configfile import update
from lava_vpr.engine.threads import cores
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.matching.decoders import decode
from lava_vpr.matching.evaluation import Metrics, evaluate
from lava_vpr.matching.matchers import confidence
from lava_vpr.model import Model, integer_model
from lava_vpr.recognition import DECODERS_ONLY, Recognition, recognise
from lava_vpr.training.references import reference_responses

Figures = dict[str, Metrics]
PAPERS = ("standard", "weighted", "probability", "weighted_probability")
console = Console(highlight=False, width=110)


def shuffled(model: Model, places: tuple[int, int], seed: int) -> Recognition:
    """Recognition of the winter images ``places`` in random order, with the noise of another seed than the model's."""
    order = np.random.default_rng(seed).permutation(np.arange(*places))
    queries = part(encoded("winter", model.config.encoder), order)
    truth = order[:, None] == np.arange(*places)[None, :]
    return recognise(model, queries, truth, DECODERS_ONLY, seed=model.config.seed + 1000 * (seed + 1), threads=cores())


def mean(results: Iterable[Metrics]) -> tuple[float, float, float]:
    """The means of R@1, R@100P and AUC."""
    rows = [(m.recall_at_1, m.recall_at_100_precision, m.auc) for m in results]
    a, b, c = np.mean(rows, axis=0)
    return float(a), float(b), float(c)


def sections(config: Config, seeds: Sequence[int]) -> dict[tuple[int, int], list[Recognition]]:
    """Every section learned and recognised with every seed: results[section][seed number]."""
    results: dict[tuple[int, int], list[Recognition]] = {}
    for section in SECTIONS:
        for seed in seeds:
            model = learn(section, dataclasses.replace(config, seed=seed))
            result = answer(model, section)
            metrics = result.metrics | as_printed(model, result)
            results.setdefault(section, []).append(dataclasses.replace(result, metrics=metrics))
    return results


def as_printed(model: Model, result: Recognition) -> Figures:
    """Figures of the paper's decoders read as its equations are printed, on the spikes of ``result``."""
    figures = {}
    for name in PAPERS:
        gamma = model.config.decoder.gamma
        scores = decode(name, model.responses, result.counts, variant="printed", gamma=gamma)
        figures[f"{name}, as printed"] = evaluate(scores, confidence(name, scores), result.truth)
    return figures


def _row(table: Table, name: str, figures: Iterable[Metrics]) -> None:
    table.add_row(name, *(f"{100 * value:.1f}" for value in mean(figures)))


def _table(title: str) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("", no_wrap=True)
    for name in ("R@1", "R@100P", "AUC"):
        table.add_column(name, justify="right")
    return table


def print_sections(config: Config, seeds: Sequence[int]) -> None:
    """Print the main table: default decoder by part and seed, the other decoders, the baselines."""
    results = sections(config, seeds)
    table = _table(f"five sections of 100 places, preset {config.preset}, seeds {', '.join(map(str, seeds))}, percent")
    every = [r for rows in results.values() for r in rows]
    default = every[0].default
    _row(table, f"all sections, {default}", (r.metrics[default] for r in every))
    parts = {"0:200 (chose the settings)": SECTIONS[:2], "200:500 (did not)": SECTIONS[2:]}
    for name, chosen in parts.items():
        _row(table, name, (r.metrics[default] for section in chosen for r in results[section]))
    for k, seed in enumerate(seeds):
        _row(table, f"seed {seed}", (rows[k].metrics[default] for rows in results.values()))
    for section, rows in results.items():
        _row(table, f"section {section[0]}:{section[1]}", (r.metrics[default] for r in rows))
    table.add_section()
    for name in every[0].metrics:
        if name != default:
            _row(table, name, (r.metrics[name] for r in every))
    console.print(table)


def print_shuffled(config: Config, seeds: Sequence[int]) -> None:
    """Print recall of queries in order, and of the same ones shuffled, with other noise."""
    table = _table("queries shuffled, with other noise, five sections")
    models = [(s, learn(s, dataclasses.replace(config, seed=seed))) for s in SECTIONS for seed in seeds]
    name = config.decoder.default
    _row(table, "in order", (answer(model, s, rivals=()).metrics[name] for s, model in models))
    for shuffle in range(2):
        _row(table, f"shuffle {shuffle}", (shuffled(model, s, shuffle).metrics[name] for s, model in models))
    console.print(table)


def print_bits(config: Config, seeds: Sequence[int]) -> None:
    """Print recall for every width of the weights."""
    table = _table("weight bits, five sections")
    for bits in range(1, 8):
        results = sections(update(config, {"network": {"weight_bits": bits}}), seeds)
        _row(table, f"{bits} bits", (r.metrics[r.default] for rows in results.values() for r in rows))
    console.print(table)


def print_learning(config: Config, seeds: Sequence[int]) -> None:
    """Print recall of learning in float, of none and of learning in integers, and of this every width of weights."""
    table = _table(f"arithmetic of learning, five sections, seeds {', '.join(map(str, seeds))}")
    integer = {"arithmetic": "integer"}
    variants: dict[str, dict[str, Any]] = {
        "float": {},
        "none: the references' rates as weights": {"learning": TEMPLATES},
        "integer: 8-bit weights, 7-bit traces": {"learning": integer},
        "the same, thresholds rise between presentations": {"learning": integer | {"theta_update": "presentation"}},
    }
    for bits in range(7, 0, -1):
        variants[f"integer, quantised to {bits} bits"] = {"learning": integer, "network": {"weight_bits": bits}}
    for name, changes in variants.items():
        results = sections(update(config, changes), seeds)
        _row(table, name, (r.metrics[r.default] for rows in results.values() for r in rows))
    console.print(table)


def print_inputs(config: Config, seeds: Sequence[int]) -> None:
    """Print recall for every kind of input."""
    table = _table("input kinds, five sections")
    for kind in INPUTS:
        results = sections(update(config, {"encoder": {"kind": kind}}), seeds)
        _row(table, f"{kind}, network", (r.metrics[r.default] for rows in results.values() for r in rows))
        _row(table, f"{kind}, cosine", (r.metrics["cosine"] for rows in results.values() for r in rows))
    console.print(table)


def with_input_mode(model: Model, mode: str) -> Model:
    """The model with its weights and another input mode, responses measured in it; learning injects in any case."""
    config = update(model.config, {"network": {"input_mode": mode}})
    network = dataclasses.replace(integer_model(model, "--inputs").network, bias_input=mode == "bias")
    references = part(encoded("summer", config.encoder), model.place_indices)
    responses = reference_responses(network, [references], config, cores())
    return dataclasses.replace(model, config=config, network=network, responses=responses)


def print_input_modes(config: Config, seeds: Sequence[int]) -> None:
    """Print recall with injected spikes beside those of compartments that integrate a bias."""
    sizes = {f"section {first}:{end}": (first, end) for first, end in SECTIONS} | {"0:500 in one model": (0, 500)}
    figures: dict[tuple[str, int, str], Metrics] = {}
    for name, places in sizes.items():
        for seed in seeds:
            model = learn(places, dataclasses.replace(config, seed=seed))
            for mode in INPUT_MODES:
                result = answer(with_input_mode(model, mode), places, rivals=())
                figures[name, seed, mode] = result.metrics[result.default]
    *five, joined = sizes
    rows: dict[str, tuple[Sequence[str], Sequence[int]]] = {"all sections": (five, seeds)}
    rows |= {"0:200 (chose the settings)": (five[:2], seeds), "200:500 (did not)": (five[2:], seeds)}
    rows |= {f"seed {seed}": (five, [seed]) for seed in seeds}
    rows |= {name: ([name], seeds) for name in five} | {joined: ([joined], seeds)}
    table = Table(title=f"ways of input, seeds {', '.join(map(str, seeds))}, percent", title_justify="left")
    table.add_column("", no_wrap=True)
    for mode in INPUT_MODES:
        for name in (f"{mode} R@1", "R@100P", "AUC"):
            table.add_column(name, justify="right")
    for name, (chosen, seeds_of_row) in rows.items():
        values = [mean(figures[key, seed, mode] for key in chosen for seed in seeds_of_row) for mode in INPUT_MODES]
        table.add_row(name, *(f"{100 * value:.1f}" for three in values for value in three))
    console.print(table)


@click.command()
@click.option("--seeds", default="0,1,2", show_default=True, help="Seeds, separated by commas.")
@click.option("--bits", is_flag=True, help="Also every width of the weights.")
@click.option("--learning", is_flag=True, help="Also learning in Loihi's integers, with every width of the weights.")
@click.option("--inputs", is_flag=True, help="Also every kind of input.")
@click.option("--input-mode", is_flag=True, help="Also both ways of input: injected spikes, and a bias.")
@click.option("--preset", "preset_name", default="loihi", show_default=True)
def main(seeds: str, bits: bool, learning: bool, inputs: bool, input_mode: bool, preset_name: str) -> None:
    """Print recall on real images."""
    required("nordland")
    config, chosen = preset(preset_name), [int(seed) for seed in seeds.split(",")]
    print_sections(config, chosen)
    print_shuffled(config, chosen)
    if bits:
        print_bits(config, chosen)
    if learning:
        print_learning(config, chosen)
    if inputs:
        print_inputs(config, chosen)
    if input_mode:
        print_input_modes(config, chosen)


if __name__ == "__main__":
    main()
