"""The tables of docs/network.md that settings decide: presets, learning, learning in integers (`make pages`)."""

from __future__ import annotations

import re

from benchmarks.figures import markdown
from lava_vpr.config import PRESETS, Config, StdpLearning, preset
from lava_vpr.engine.inference.fixed import DIRECT, FAN_IN, inhibitory_depth, input_delay, silent_steps
from lava_vpr.engine.learning.integer import phases

INTEGER = [name for name in PRESETS if name != "paper"]
ROWS = (
    "`network.steps`: a presentation, silent steps included",
    "`encoder.query_inputs`: of 2048, those that respond most",
    "`encoder.query_spikes`: input spikes a step",
    "`network.signed`, `weight_bits`",
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
    both = phases(config.learning, config.encoder.inputs, config.encoder.train_spikes)  # type: ignore[arg-type]
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


PARTS = {"silent": silent, "presets": presets, "learning": learning, "integers": integers}
