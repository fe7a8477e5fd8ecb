"""The parts of README and docs that code and records decide, as Markdown; `scripts.pages` writes them into pages.

Commands (docs/cli.md), settings (docs/network.md), limits, ranges and arrays of a model (docs/security.md), what is
believed about hardware (docs/hardware.md), and the tables of figures and results.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping

import click

from benchmarks.figures import PARTS as FIGURES, markdown
from benchmarks.results.tables import PARTS as RESULTS
from lava_vpr.backends.rivals import BASELINES
from lava_vpr.cli import main
from lava_vpr.cli.show.headings import OPTIONS, help_records
from lava_vpr.cli.show.matches import ALWAYS
from lava_vpr.config import PRESETS, Config, DecoderConfig, StdpLearning, preset
from lava_vpr.configfile import sections
from lava_vpr.deploy.hardware.belief import HardwareBelief
from lava_vpr.deploy.hardware.table import BELIEFS, SECTIONS
from lava_vpr.engine.inference.fixed import DIRECT, FAN_IN, inhibitory_depth, input_delay, silent_steps
from lava_vpr.engine.learning.integer import phases
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.modelfile import Sizes, array_rules
from lava_vpr.settings.ranges import declared
from lava_vpr.storage.arrays import ArrayRule
from lava_vpr.storage.limits import LIMITS, variable

WIDTH = 100_000  # click breaks lines at the width of a terminal; here nothing is to be broken
NAMES = main.context_settings["help_option_names"]
CONTEXT = click.Context(
    main, info_name="lava-vpr", terminal_width=WIDTH, max_content_width=WIDTH, help_option_names=NAMES
)
EVAL_KEYS = """```
{{"model": NAME, "query": NAME, "version": "x.y.z", "places": n, "queries": n,
 "network": {{"neurons": n, "weight_bits": n or null, "steps": n}},
 "default_decoder": NAME,
 "decoders": {{{decoders}}},
 "baselines": {{{baselines}}},
 "adapted": {{NAME: M}},
 "learned": {{NAME: M}}, "taught": {{"single": {{"answers": n, "wrong": n}}, "filtered": {{"answers": n, "wrong": n}}}},
 "position_error": {{"median_m": x, "p90_m": x, "within": x, "radius_m": x, "matched": n}} or null,
 "followed": {{"filtered": M, "forward_backward": M}},
 "probability": {{"single": P, "filtered": P}},
 "curves": {{"decoders": {{NAME: C}}, "baselines": {{NAME: C}}, "adapted": {{NAME: C}}, "learned": {{NAME: C}},
            "followed": {{NAME: C}}}},
 "seeds": [{{"seed": n, "decoders": {{NAME: M}}, "baselines": {{"template": M}}, "adapted": {{NAME: M}},
            "followed": {{NAME: M}}, "learned": {{NAME: M}}}}, ...]}}

M = {{"recall_at_1": x, "recall_at_n": {{"5": x, "10": x}}, "recall_at_100_precision": x,
     "precision_at_100_recall": x, "auc": x}}
P = {{"expected_calibration_error": x, "off_map": x,
     "reliability": [{{"answers": n, "probability": x, "right": x}}, ...],
     "thresholds": [{{"target": x, "probability": x, "accepted": x, "precision": x, "kept": x,
                     "false_accepts": x}}, ...]}}
C = {{"recall": [x, ...], "precision": [x, ...], "threshold": [x or null, ...]}}
```"""


def cell(text: str) -> str:
    """Text for one cell of a table: on one line, with nothing in it that Markdown would take for its own."""
    text = " ".join(text.split()).replace("|", r"\|").replace("*", r"\*").replace(r"\*\*", "**")
    return re.sub(r"\[(?=[^\[\]]*(?:x[<>]|[<>]=?x))", r"\\[", text)


def paragraphs(text: str) -> str:
    """A docstring as Markdown paragraphs."""
    return "\n\n".join(" ".join(part.split()) for part in inspect.cleandoc(text).split("\n\n"))


def described(name: str, command: click.Command, parent: click.Context) -> str:
    """The reference of one command."""
    # Commands are shown as in a window so wide that nothing is broken.
    ctx = click.Context(command, info_name=name, parent=parent, terminal_width=WIDTH, max_content_width=WIDTH)
    usage = " ".join(command.get_usage(ctx).removeprefix("Usage:").split())
    tables = []
    for heading, records in help_records(command, ctx).items():
        rows = [
            f"| `{cell(words)}` | {cell(text)} |" for words, text in records if "--help" not in words
        ]  # all have it
        title = "option" if heading == OPTIONS else heading
        tables += ["\n".join([f"| {title} | |", "|---|---|", *rows])] if rows else []
    return "\n\n".join([f"## {name}", f"```\n{usage}\n```", paragraphs(command.help or ""), *tables])


def commands() -> dict[str, click.Command]:
    """All commands by name."""
    return {name: command for name in main.list_commands(CONTEXT) if (command := main.get_command(CONTEXT, name))}


def usage() -> str:
    """What each command is for, in a line."""
    every = commands()
    width = max(map(len, every))
    lines = (f"lava-vpr {name:<{width}}  {command.get_short_help_str(WIDTH)}" for name, command in every.items())
    return "\n".join(["```", *lines, "```"])


def eval_keys() -> str:
    """The keys of `eval --json`."""
    decoders = sorted(DECODERS, key=lambda name: name == DecoderConfig().default)  # the paper's first, as in the file
    matchers = {"decoders": decoders, "baselines": (*BASELINES, "descriptors")}
    return EVAL_KEYS.format(**{kind: ", ".join(f'"{name}": M' for name in known) for kind, known in matchers.items()})


INTEGER = [name for name in PRESETS if name != "paper"]
ROWS = (
    "`network.steps`: a presentation, silent steps included",
    "`encoder.orientations`, in each of 16 x 16 cells",
    "`encoder.query_inputs`: those that respond most",
    "`encoder.train_spikes`, `query_spikes`: input spikes a step",
    "`network.signed`, `weight_bits`",
    "`network.surroundings`, places on either side",
    "`network.prune`, of each neuron's weights",
    "`network.threshold`, in U",
    "`network.inhibition`, in U",
    "`network.tau_membrane`, in steps",
    "`network.trains`, `input_mode`",
)
"""What the presets differ in or are known by; a name without a section is of the same as that before it."""


def values(config: Config, row: str) -> str:
    """The settings that a row names, as the page has them."""
    section, words = "", []
    for name in re.findall(r"`([a-z_.]+)`", row):
        section, _, key = name.rpartition(".") if "." in name else (section, "", name)
        value = getattr(getattr(config, section), key)
        words.append(str(value).lower() if isinstance(value, (bool, str)) else f"{value:g}")
    return ", ".join(words)


def presets() -> str:
    """What the presets of the integer network differ in."""
    rows = [[row, *(values(preset(name), row) for name in INTEGER)] for row in ROWS]
    return markdown(["", *(f"`{name}`" for name in INTEGER)], rows)


def learning() -> str:
    """What learning does in its two phases."""
    rule = preset("loihi").learning
    if not isinstance(rule, StdpLearning):
        raise TypeError("preset loihi learns by STDP")
    first = [rule.competition_epochs, rule.eta, rule.tau_trace, rule.x_target]
    second = [rule.epochs - rule.competition_epochs, rule.consolidation_eta]
    second += [rule.consolidation_tau_trace, rule.consolidation_x_target]
    rising = f"{rule.threshold:g}, + {rule.theta_plus:g} for every spike"
    falling = {0.5: "halved once, then constant", 1.0: "constant"}[rule.consolidation_threshold]
    rows = [["competition", *(f"{value:g}" for value in first), rising]]
    rows += [["consolidation", *(f"{value:g}" for value in second), falling]]
    return markdown(["", "epochs", "eta", "tau of the trace", "x_target", "threshold"], rows)


def integers() -> str:
    """The rules of learning in integers, in Lava's notation."""
    config, rows = preset("loihi"), []
    both = phases(config.learning, config.encoder.inputs, config.encoder.learning_spikes)  # type: ignore[arg-type]
    for name, phase in zip(("competition", "consolidation"), both, strict=True):
        products = (f"{scale}*2^{exponent}*y0*(x1-{phase.rule.target})" for scale, exponent in phase.rule.products)
        rows.append([name, f"`{' + '.join(products)}`", f"tau {phase.rule.tau:g}", f"{phase.neurons.theta_plus}"])
    return markdown(["", "rule", "trace", "theta per spike"], rows)


def silent() -> str:
    """Steps from an input to the neurons (d), from their spikes to what inhibits them (e), and silent ones."""
    rows = []
    for title, neurons in ((f"up to {DIRECT:,}", DIRECT), (f"up to {FAN_IN:,}", FAN_IN), ("more", FAN_IN + 1)):
        e = inhibitory_depth(neurons) + 1
        modes = ((input_delay(neurons, bias), e, silent_steps(neurons, bias)) for bias in (False, True))
        rows.append([title, *(", ".join(map(str, mode)) for mode in modes)])
    return markdown(["neurons", "injected: d, e, silent steps", "bias: d, e, silent steps"], rows)


def limits() -> str:
    """The table of all limits."""
    rows = [f"| `{variable(name)}` | {row.default:,} {row.unit} | {row.reason} |" for name, row in LIMITS.items()]
    return "\n".join(["| variable | default | why so much |", "|---|---|---|", *rows])


def ranges() -> str:
    """The table of the ranges of all settings."""
    rows = ["| section | settings and their ranges |", "|---|---|"]
    for section, name in sections().items():
        texts = [f"`{key}` {setting}".replace(" in ", " ") for key, setting in declared(section).items()]
        rows.append(f"| {f'`[{name}]`' if name else ''} `{section.__name__}` | {', '.join(texts)} |")
    return "\n".join(rows)


def arrays() -> str:
    """The table of what every array of a model must be, with the integer network and with preset ``paper``."""
    sizes = Sizes(100, 200, 102, 103)  # two images a place; each length tells whose it is
    rows = ["| array | with preset | type and shape | values |", "|---|---|---|---|"]
    both = {name: array_rules(preset(name), sizes) for name in ("loihi", "paper")}
    for array in sorted({array for rules in both.values() for array in rules}):
        found = {name: _written(rules[array], sizes) for name, rules in both.items() if array in rules}
        if len(found) == 2 and len(set(found.values())) == 1:
            found = {"any": found["loihi"]}
        rows += [f"| `{array}` | {name} | {rule} |" for name, rule in found.items()]
    return "\n".join(rows)


def _written(rule: ArrayRule, sizes: Sizes) -> str:
    names = dict(zip(sizes, Sizes._fields, strict=True))
    shape = ", ".join(names.get(length, str(length)) for length in rule.shape)
    return f"{rule.dtype} ({shape}) | {rule.least:g} .. {rule.most:g}"


def line(row: HardwareBelief) -> str:
    """The line of one row."""
    cells = (row.name, row.on, row.shown, row.unit or "", row.evidence, row.breaks)
    return f"| {' | '.join(cell(text).replace('<', '&lt;') for text in cells)} |"


def beliefs() -> str:
    """How many rows there are, and the tables of all sections."""
    proven = sum(row.proven for row in BELIEFS.values())
    text = [f"{len(BELIEFS)} rows: {proven} with a public source, {len(BELIEFS) - proven} unproven."]
    for title, rows in SECTIONS.items():
        head = "| register, limit or call | of | value | unit | source | what breaks if it is wrong |"
        text.append("\n".join([f"## {title}\n", head, "|---|---|---|---|---|---|", *map(line, rows)]))
    return "\n\n".join(text)


PARTS: Mapping[str, Callable[[], str]] = {
    "cli/usage": usage,
    "cli/commands": lambda: "\n\n".join(described(*row, CONTEXT) for row in commands().items()),
    "cli/eval-keys": eval_keys,
    "cli/columns": lambda: f"```\n{','.join(column.name for column in ALWAYS)}\n```",
    **{f"figures/{name}": part for name, part in FIGURES.items()},
    "hardware/beliefs": beliefs,
    **{f"results/{name}": part for name, part in RESULTS.items()},
    "security/limits": limits,
    "security/settings": ranges,
    "security/arrays": arrays,
    "settings/silent": silent,
    "settings/presets": presets,
    "settings/learning": learning,
    "settings/integers": integers,
}
"""All parts, by the kind and name that their marks have: functions that make Markdown."""
