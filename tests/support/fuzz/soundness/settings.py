"""Settings as dictionaries: names, types, ranges and what belongs together, written out a second time.

Used by storage and support.
"""

from __future__ import annotations

import math
from typing import Any

import tomli
from support.fuzz.soundness.rules import Findings

Range = tuple[str, float, float]
"""Type (``i``, ``f``; with ``<`` or ``>`` the low or high end itself is outside), least and most."""

TRUTH = (False, True)
TEXT: tuple[str, ...] = ()
"""Any text; what else it must be is not told apart here."""

MOST = math.inf
ENCODER: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "kind": ("orientation", "filters", "onoff", "pixels", "events", "vector", "rates"),
    "saturation": ("f<", 0, 1),
    "image_size": ("i", 8, 512),
    "cell": ("i", 1, 512),
    "orientations": ("i", 2, 16),
    "window": ("i", 3, 255),
    "pool_floor": ("f", 0, 100),
    "blur": ("f", 0, 50),
    "train_spikes": ("f<", 0, 1000),
    "query_spikes": ("f<", 0, 1000),
    "query_inputs": ("i", 0, 1_000_000),
    "max_rate_hz": ("f<", 0, 1000),
    "filters": TEXT,
    "vector_values": ("i", 0, 1_000_000),
    "vector_kept": ("i", 1, 1_000_000),
    "vector_scale": ("shared", "own"),
    "vector_dead_zone": ("f", 0, 10),
}
VIEWS: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "shifts": ("i", 1, 99),
    "shift": ("f", 0, 0.5),
    "scales": ("i", 1, 99),
    "scale": ("f", 1, 2),
}
EVENTS: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "window_ms": ("f", 0.1, 3_600_000),
    "window_events": ("i", 0, 1_000_000_000),
    "image": ("counts", "surface"),
    "side": ("i", 8, 512),
    "refractory_us": ("i", 0, 10_000_000),
    "hot_pixels": ("f", 0, 1_000_000),
}
SLAYER: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "start": ("template", "scratch"),
    "rate": ("f<", 0, 10),
    "batch": ("i", 1, 10_000),
    "sharpness": ("f<", 0, 100),
    "surrogate": ("f", 0.001, 100),
}
AUGMENT: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "shift": ("f", 0, 100),
    "contrast": ("f", 0, 10),
    "illumination": ("f", 0, 10),
    "noise": ("f", 0, 10),
    "altered": ("f", 0, 1),
}
LIF: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "model": ("lif",),
    "neurons": ("i", 0, 100_000),
    "neurons_per_place": ("f<", 0, 100),
    "steps": ("i", 4, 65_536),
    "signed": TRUTH,
    "weight_bits": ("i", 1, 8),
    "prune": ("f>", 0, 1),
    "threshold": ("f<", 0, 10_000),
    "inhibition": ("f", 0, 10_000),
    "tau_membrane": ("f<", 1, 4096),
    "trains": ("poisson", "regular"),
    "input_mode": ("injected", "bias"),
}
STDP: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "rule": ("stdp", "template", "slayer"),
    "arithmetic": ("float", "integer"),
    "trains": ("poisson", "regular"),
    "theta_update": ("spike", "presentation"),
    "recruit": TRUTH,
    "epochs": ("i", 1, 10_000),
    "competition_epochs": ("i", 1, 10_000),
    "steps": ("i", 1, 100_000),
    "eta": ("f", 0, 10),
    "tau_trace": ("f", 1, 10_000),
    "x_target": ("f", 0, 100),
    "consolidation_eta": ("f", 0, 10),
    "consolidation_tau_trace": ("f", 1, 10_000),
    "consolidation_x_target": ("f", 0, 100),
    "w_max": ("f<", 0, 1000),
    "mu": ("f", 0, 8),
    "threshold": ("f<", 0, 10_000),
    "theta_plus": ("f", 0, 1000),
    "consolidation_threshold": ("f<", 0, 10),
    "inhibition": ("f", 0, 10_000),
    "tau_membrane": ("f<", 1, 4096),
    "floor": ("f", -1_000_000, 0),
    "drive": ("f<", 0, 100),
    "hold_steps": ("i", 0, 1000),
    "mean_weight": ("f<", 0, 1000),
    "start_weight": ("f<", 0, 1000),
}
CONDUCTANCE: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "model": ("conductance",),
    "neurons": ("i", 1, 100_000),
    "dt_ms": ("f", 0.01, 1),
    "steps": ("i", 1, 1_000_000),
    "rest_steps": ("i", 0, 1_000_000),
    "tau_ge_ms": ("f", 0.1, 1000),
    "tau_gi_ms": ("f", 0.1, 1000),
    "delay_max_ms": ("f", 0, 100),
    "timer_rate": ("f<", 0, 1),
}
RULES: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "rule": ("triplet", "paper"),
    "arithmetic": ("float",),
    "epochs": ("i", 1, 10_000),
    "label_epochs": ("i", 1, 10_000),
    "eta_pre": ("f", 0, 1),
    "eta_post": ("f", 0, 1),
    "x_target": ("f", 0, 1),
    "mu": ("f", 0, 8),
    "w_max": ("f<", 0, 1000),
    "weight_sum": ("f<", 0, 1_000_000),
    "theta_start_mv": ("f<", 0, 1000),
    "theta_plus_mv": ("f", 0, 100),
    "tau_theta_ms": ("f", 1, 1e30),
}
DECODERS = ("contrast", "standard", "weighted", "probability", "weighted_probability")
DECODER: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {"default": DECODERS, "gamma": ("f", 0, 1)}
TOP: dict[str, Range | tuple[str, ...] | tuple[bool, ...]] = {
    "preset": ("loihi", "fast", "paper"),
    "seed": ("i", 0, 2**63 - 1),
    "stretch": ("i", 0, 1_000_000),
}


def check(config: Any, findings: Findings) -> bool:
    """Check complete settings, as the reader returns them; whether they can be asked further."""
    before = len(findings)
    if not findings.need(isinstance(config, dict), "T1", "no settings"):
        return False
    conductance = isinstance(config.get("network"), dict) and config["network"].get("model") == "conductance"
    tables = {
        "encoder": ENCODER,
        "views": VIEWS,
        "events": EVENTS,
        "network": CONDUCTANCE if conductance else LIF,
        "learning": RULES if conductance else STDP,
        "slayer": SLAYER,
        "augment": AUGMENT,
        "decoder": DECODER,
    }
    findings.need(set(config) == {*TOP, *tables}, "T1", f"top level {sorted(config)}")
    _section({key: config.get(key) for key in TOP}, TOP, "top level", findings)
    for name, table in tables.items():
        if findings.need(isinstance(config.get(name), dict), "T1", f"[{name}] is no table"):
            _section(config[name], table, name, findings)
    if len(findings) > before:
        return False
    _together(config, conductance, findings)
    return len(findings) == before


def _section(values: dict[str, Any], table: dict[str, Any], name: str, findings: Findings) -> None:
    findings.need(set(values) == set(table), "T1", f"[{name}] has {sorted(set(values) ^ set(table))[:3]}")
    for key, allowed in table.items():
        value = values.get(key)
        if allowed is TRUTH:
            findings.need(type(value) is bool, "T1", f"{name}.{key} is {value!r:.40}")
            continue
        if allowed is TEXT:
            findings.need(isinstance(value, str), "T1", f"{name}.{key} is {value!r:.40}")
            continue
        if not _is_range(allowed):
            findings.need(isinstance(value, str) and value in allowed, "T2", f"{name}.{key} is {value!r:.40}")
            continue
        kind, low, high = allowed
        right = type(value) is int if kind[0] == "i" else type(value) is float
        if findings.need(right, "T1", f"{name}.{key} is {value!r:.40}"):
            above = low < value if "<" in kind else low <= value
            below = value < high if ">" in kind else value <= high
            findings.need(above and below, "T2", f"{name}.{key} is {value!r:.40}")


def _is_range(allowed: tuple[Any, ...]) -> bool:
    return len(allowed) == 3 and not isinstance(allowed[1], str)


def _together(config: dict[str, Any], conductance: bool, findings: Findings) -> None:
    encoder, network, learning = config["encoder"], config["network"], config["learning"]
    findings.need(encoder["image_size"] % encoder["cell"] == 0, "T3", "cells that do not fill the image")
    findings.need(encoder["window"] % 2 == 1, "T3", "an even window")
    views = config["views"]
    findings.need(views["shifts"] % 2 == views["scales"] % 2 == 1, "T3", "views without the straight one")
    findings.need(views["shift"] * ((views["shifts"] - 1) // 2) < 1, "T3", "views beyond the image")
    if conductance:
        findings.need(views_of(config) == 1, "T3", "views of a conductance network")
        findings.need(encoder["kind"] == "pixels", "T3", "a conductance network of other inputs than pixels")
        return
    findings.need(learning["mean_weight"] < learning["w_max"], "T3", "mean_weight not below w_max")
    findings.need(learning["start_weight"] <= learning["w_max"], "T3", "start_weight above w_max")
    findings.need(network["model"] == "lif", "T3", "another network")
    findings.need(network["steps"] in [1 << k for k in range(2, 17)], "T3", "steps that are no power of two")
    findings.need(network["weight_bits"] + network["signed"] <= 8, "T3", "more than 8 bits with the sign")
    findings.need(
        network["trains"] == "regular" or network["input_mode"] == "injected", "T3", "biases of Poisson trains"
    )


def views_of(config: dict[str, Any]) -> int:
    """The number of views of a reference under sound settings."""
    return int(config["views"]["shifts"] * config["views"]["scales"])


def inputs_of(config: dict[str, Any]) -> int:
    """The number of inputs under sound settings."""
    encoder = config["encoder"]
    if encoder["kind"] in ("orientation", "events"):
        return int(encoder["orientations"] * (encoder["image_size"] // encoder["cell"]) ** 2)
    if encoder["kind"] == "vector":
        return int(2 * min(encoder["vector_values"], encoder["vector_kept"]))
    if encoder["kind"] == "rates":
        return int(encoder["vector_values"])
    return 784 * (2 if encoder["kind"] == "onoff" else 1)


def as_said(said: Any, config: dict[str, Any], findings: Findings) -> None:
    """Whether ``config`` has every setting that is ``said``, number for number."""
    if not findings.need(isinstance(said, dict), "T4", "settings that are no table"):
        return
    for key, value in said.items():
        if isinstance(value, dict):
            inner = config.get(key)
            if findings.need(isinstance(inner, dict), "T4", f"{key!r:.40} is no section"):
                as_said(value, inner if isinstance(inner, dict) else {}, findings)
        else:
            taken = config.get(key)
            same = type(taken) is type(value) or (type(taken) is float and type(value) is int)
            findings.need(
                key in config and same and taken == value, "T4", f"{key!r:.40}: {value!r:.30} read as {taken!r:.30}"
            )


def check_toml(data: bytes, config: Any, presets: dict[str, Any]) -> Findings:
    """The rules T that the settings in a TOML file break.

    Args:
        data: The file.
        config: What the reader made of it, as nested dictionaries.
        presets: The settings of every preset, as nested dictionaries.
    """
    findings = Findings()
    try:
        said = tomli.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        findings.need(False, "T1", f"no TOML ({error!r:.60})")
        return findings
    if check(config, findings):
        as_said(said, config, findings)
        base = presets.get(said.get("preset", "loihi"), {})
        for section, values in config.items():
            mine = said.get(section, {})
            for key, value in values.items() if isinstance(values, dict) else ():
                if key not in mine:
                    findings.need(base.get(section, {}).get(key) == value, "T4", f"{section}.{key} is not the preset's")
    return findings
