"""Loihi 2 bundles: Lava's parameters, and the network that learns.

Used by support.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from support.fuzz.soundness.parsing import array_of, json_of
from support.fuzz.soundness.rules import Findings, whole

INTERVAL = 3
LEARNING = {"weights": ("u1", 2), "thresholds": ("i4", 1), "epochs": ("i4", 1), "images": ("i4", 1), "keys": ("u8", 1)}


def check_parameters(
    files: Mapping[str, bytes], said: Mapping[str, Any], weights: NDArray[np.uint8], findings: Findings
) -> None:
    """B8 and B9 of a bundle whose reader returned ``weights``."""
    for name in ("network/weights.npy", "network/parameters.json"):
        if not findings.need(name in files, "B9", f"no {name}"):
            return
    stored = array_of(files["network/weights.npy"], findings, "network/weights.npy")
    told = json_of(files["network/parameters.json"], findings, "B9", "network/parameters.json")
    if stored is None or not findings.need(isinstance(told, dict), "B9", "no parameters"):
        return
    fits = stored.dtype == np.uint8 and stored.shape == weights.T.shape
    if not findings.need(fits, "B8", f"weights {stored.dtype} {stored.shape}"):
        return
    bits = told.get("excite", {}).get("num_weight_bits") if isinstance(told.get("excite"), dict) else None
    if not findings.need(whole(bits, 1, 8), "B9", f"num_weight_bits {bits!r:.30}"):
        return
    spare = 8 - bits
    findings.need(np.array_equal(stored.astype(int), weights.T.astype(int) << spare), "B8", "other weights")
    names = ("bits", "shift", "threshold", "inhibition", "inhibition_exponent", "decay", "steps", "regular")
    network = {"inputs": said["inputs"], "neurons": said["neurons"], **{name: said[name] for name in names}}
    reset = {"reset_interval": said["steps"] + 3, "reset_offset": 1}
    findings.need(0 <= said["decay"] <= 4095, "B9", "a decay beyond 12 bits")
    expected = {
        "network": network,
        "steps": said["steps"],
        "silent_steps": 3,
        "excite": {"num_weight_bits": bits, "weight_exp": -spare - said["shift"]},
        "exc": {"du": 4095, "dv": said["decay"], "vth": said["threshold"], **reset},
        "inhibit": {"weight": -said["inhibition"], "num_weight_bits": 8, "weight_exp": said["inhibition_exponent"]},
    }
    for name, value in expected.items():
        same = told.get(name) == value and _whole_numbers(told.get(name))
        findings.need(same, "B9", f"{name} is {told.get(name)!r:.60}")
    findings.need(set(told) == {*expected, "inputs", "relay", "inh"}, "B9", f"parameters {sorted(told)}")


def _whole_numbers(value: Any) -> bool:
    """Whether all numbers in ``value`` are whole: true and 1.0 equal 1, and are none."""
    if isinstance(value, dict):
        return all(_whole_numbers(below) for below in value.values())
    return type(value) is int


def check_learning(files: Mapping[str, bytes], config: Any, header: Mapping[str, Any], findings: Findings) -> None:
    """B10 of the networks that learn."""
    told = json_of(files["learning/learning.json"], findings, "B10", "learning/learning.json")
    rates = array_of(files.get("learning/rates.npy", b""), findings, "learning/rates.npy")
    stretches = header.get("stretches") or []
    parts = told.get("stretches") if isinstance(told, dict) else None
    good = isinstance(parts, list) and len(parts) == len(stretches) and all(isinstance(p, dict) for p in parts)
    if rates is None or not findings.need(good, "B10", "no stretches") or not isinstance(parts, list):
        return
    images, inputs = header["arrays"]["activity"].shape
    findings.need(
        rates.dtype == np.uint16 and rates.shape == (images, inputs), "B10", f"rates {rates.dtype} {rates.shape}"
    )
    for part, stretch in zip(parts, stretches, strict=True):
        own = [part.get(name) for name in ("first_place", "places", "first_neuron", "neurons")]
        findings.need(own == list(stretch), "B10", f"stretch {own!r:.40}")
        folder = part.get("folder")
        if findings.need(isinstance(folder, str), "B10", "a stretch without folder") and isinstance(folder, str):
            _stretch(files, folder, part, (inputs, stretch[3], images), config, findings)


def _stretch(
    files: Mapping[str, bytes],
    folder: str,
    part: Mapping[str, Any],
    sizes: tuple[int, int, int],
    config: Any,
    findings: Findings,
) -> None:
    inputs, neurons, images = sizes
    arrays: dict[str, NDArray[Any]] = {}
    for name, (kind, ndim) in LEARNING.items():
        array = array_of(files.get(f"{folder}/{name}.npy", b""), findings, f"{folder}/{name}.npy")
        if array is None:
            return
        fits = array.dtype == np.dtype(kind) and array.ndim == ndim
        if not findings.need(fits, "B10", f"{folder}/{name} is {array.dtype} {array.shape}"):
            return
        arrays[name] = array
    findings.need(arrays["weights"].shape == (inputs, neurons), "B10", f"weights {arrays['weights'].shape}")
    thresholds = arrays["thresholds"]
    sound = thresholds.shape == (neurons,) and bool(((thresholds >= 1) & (thresholds < 1 << 17)).all())
    findings.need(sound, "B10", "thresholds beyond 1..2^17-1")
    seeds, phases = part.get("rng_seeds"), part.get("phases")
    good = isinstance(seeds, list) and all(whole(seed, 0, (1 << 31) - 1) for seed in seeds)
    findings.need(good, "B10", f"seeds {seeds!r:.40}")
    epochs, shown = arrays["epochs"], arrays["images"]
    equal = len(epochs) == len(shown) == len(arrays["keys"])
    most = len(seeds) if isinstance(seeds, list) else 0
    rising = bool((np.diff(epochs) >= 0).all()) and bool(((epochs >= 0) & (epochs < most)).all())
    inside = bool(((shown >= 0) & (shown < images)).all())
    findings.need(equal and rising and inside, "B10", "presentations that name no epoch or image")
    if findings.need(isinstance(phases, list) and phases, "B10", "no phases") and isinstance(phases, list):
        for phase in phases:
            findings.need(_phase(phase, neurons), "B10", f"a phase beyond the engine: {phase!r:.60}")
        told = [phase.get("epochs") for phase in phases if isinstance(phase, dict)]
        findings.need(all(whole(n, 0, most) for n in told) and sum(told) == most, "B10", f"epochs {told} of {most}")


def _phase(phase: Any, neurons: int) -> bool:
    """Whether a phase is within the learning engine's bits."""
    try:
        rule, host, inhibit = phase["learning_rule"], phase["host"], phase["inhibit"]
        products = rule["products"]
        good = all(whole(m, -8, 7) and whole(e, -7, 8) for m, e in products)
        terms = [f"{m}*2^{e}*y0*(x1-{rule['target']})" + "*(255-w)" * rule["mu"] for m, e in products]
        good = good and rule["dw"] == " + ".join(terms).replace("+ -", "- ")
        good = (
            good and whole(rule["target"], 0, 127) and whole(rule["mu"], 0, 2) and whole(rule["x1_impulse"], 127, 127)
        )
        tau = rule["x1_tau"]
        good = good and type(tau) in (int, float) and math.isfinite(tau) and 1 <= tau <= 10_000
        good = good and whole(phase["plastic"]["weight_exp"], -7, 0)
        good = good and whole(phase["exc"]["du"], 0, 4096) and whole(phase["exc"]["dv"], 0, 4096)
        good = good and whole(inhibit["mantissa"], 0, 255) and whole(inhibit["weight_exp"], 0, 10)
        good = good and (neurons - 1) * (inhibit["mantissa"] << inhibit["weight_exp"]) < 1 << 17
        good = good and whole(phase["steps"], 1, 100_000) and whole(phase["silent_steps"], 3, 3)
        good = good and all(whole(host[name], 0, 1 << 31) for name in ("weight_sum", "theta_plus", "threshold_factor"))
        return bool(good and re.fullmatch(r"[0-9xyw()*+^ -]*", rule["dw"]))
    except (KeyError, TypeError, ValueError, AttributeError):
        return False
