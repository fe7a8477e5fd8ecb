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
from support.fuzz.soundness.models import NUMBERS, silence
from support.fuzz.soundness.parsing import array_of, json_of
from support.fuzz.soundness.rules import Findings, whole

LEARNING = {"weights": ("u1", 2), "thresholds": ("i4", 1), "epochs": ("i4", 1), "images": ("i4", 1), "keys": ("u8", 1)}


def check_parameters(
    files: Mapping[str, bytes], said: Mapping[str, Any], weights: NDArray[np.int16], findings: Findings
) -> None:
    """B8 and B9 of a bundle whose reader returned ``weights``."""
    for name in ("network/weights.npy", "network/bias.npy", "network/parameters.json"):
        if not findings.need(name in files, "B9", f"no {name}"):
            return
    stored, mantissas = (array_of(files[f"network/{name}.npy"], findings, name) for name in ("weights", "bias"))
    told = json_of(files["network/parameters.json"], findings, "B9", "network/parameters.json")
    if stored is None or mantissas is None or not findings.need(isinstance(told, dict), "B9", "no parameters"):
        return
    fits = stored.dtype == np.int16 and stored.shape == weights.T.shape
    if not findings.need(fits, "B8", f"weights {stored.dtype} {stored.shape}"):
        return
    spare = 8 - said["bits"]
    findings.need(np.array_equal(stored.astype(int), weights.T.astype(int) << spare), "B8", "other weights")
    findings.need(0 <= said["decay"] <= 4095, "B9", "a decay beyond 12 bits")
    exponent = told.get("exc", {}).get("bias_exp") if isinstance(told.get("exc"), dict) else None
    _bias(mantissas, exponent, said, findings)
    for name, value in _expected(said, exponent).items():
        same = told.get(name) == value and _whole_numbers(told.get(name))
        findings.need(same, "B9", f"{name} is {told.get(name)!r:.60}")
    findings.need(set(told) == set(_expected(said, exponent)), "B9", f"parameters {sorted(told)}")
    interval = said["steps"] + silence(said["neurons"], said["bias_input"])
    findings.need(interval in RESETS, "B9", f"{interval} steps, no power of two")


def _bias(mantissas: NDArray[Any], exponent: Any, said: Mapping[str, Any], findings: Findings) -> None:
    """B9 of the biases: in the least exponent that holds them, and none by which its neuron spikes."""
    fits = mantissas.dtype == np.int32 and mantissas.shape == (said["neurons"],) and whole(exponent, 0, 7)
    if not findings.need(fits, "B9", f"biases {mantissas.dtype} {mantissas.shape} with the exponent {exponent!r:.20}"):
        return
    values = [int(value) for value in mantissas]
    largest = max(map(abs, values), default=0)
    findings.need(largest < 4096 and (exponent == 0 or largest >= 2048), "B9", f"mantissas up to {largest}")
    highest = said["threshold"] * 64 * said["decay"] // 4096
    findings.need(max(values, default=0) << exponent <= highest, "B9", f"a bias above {highest}")


RESETS = {1 << exponent for exponent in range(17)}
"""Steps between two resets of a Loihi 2: powers of two."""


def _expected(said: Mapping[str, Any], bias_exponent: Any) -> dict[str, Any]:
    """The parameters of the network that the manifest tells."""
    silent, spare = silence(said["neurons"], said["bias_input"]), 8 - said["bits"]
    reset = {"reset_interval": said["steps"] + silent, "reset_offset": 1}
    leaves = -(-said["neurons"] // 4096) if said["neurons"] > 4096 else 0
    one = {"num_weight_bits": 8, "weight_exp": 0}
    return {
        "network": {name: said[name] for name in ("inputs", "neurons", *NUMBERS)},
        "steps": said["steps"],
        "silent_steps": silent,
        "level": 512_000 if said["regular"] else None,
        "inputs": {"du": 4095, "dv": 0, "vth": 8000} if said["bias_input"] else None,
        "relayed": int(said["neurons"] > 1024 and not said["bias_input"]),
        "leaves": leaves,
        "fan_in": 4096,
        "excite": {
            "num_weight_bits": said["bits"] + said["signed"],
            "weight_exp": -spare,
            "sign_mode": "MIXED" if said["signed"] else "EXCITATORY",
        },
        "exc": {"du": 4095, "dv": said["decay"], "vth": said["threshold"], "bias_exp": bias_exponent, **reset},
        "relay": {"weight": 2, **one, "sign_mode": "EXCITATORY"},
        "inh": {"du": 4095, "dv": 4095, "vth": 1, **reset},
        "inhibit": {
            "weight": -said["inhibition"],
            "num_weight_bits": 8,
            "weight_exp": said["inhibition_exponent"],
            "sign_mode": "INHIBITORY",
        },
    }


def _whole_numbers(value: Any) -> bool:
    """Whether all numbers in ``value`` are whole: true and 1.0 equal 1, and are none."""
    if isinstance(value, dict):
        return all(_whole_numbers(below) for below in value.values())
    return value is None or isinstance(value, str) or type(value) is int


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
        own = [part.get(name) for name in ("first_place", "places", "first_neuron", "neurons", "view", "removed")]
        findings.need(own == [*stretch, 0][:6], "B10", f"stretch {own!r:.40}")
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
            findings.need(_phase(phase), "B10", f"a phase beyond the engine: {phase!r:.60}")
        told = [phase.get("epochs") for phase in phases if isinstance(phase, dict)]
        findings.need(all(whole(n, 0, most) for n in told) and sum(told) == most, "B10", f"epochs {told} of {most}")


def _phase(phase: Any) -> bool:
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
        good = good and whole(phase["plastic"]["weight_exp"], 0, 0) and phase["trains"] in ("regular", "poisson")
        good = good and whole(phase["exc"]["du"], 0, 4096) and whole(phase["exc"]["dv"], 0, 4096)
        good = good and whole(inhibit["mantissa"], 0, 255) and whole(inhibit["weight_exp"], 0, 10)
        good = good and inhibit["mantissa"] << inhibit["weight_exp"] < 1 << 17
        good = good and whole(phase["steps"], 1, 100_000) and whole(phase["silent_steps"], 3, 65_536)
        good = good and phase["steps"] + phase["silent_steps"] in RESETS
        good = good and all(whole(host[name], 0, 1 << 31) for name in ("weight_sum", "theta_plus", "threshold_factor"))
        return bool(good and re.fullmatch(r"[0-9xyw()*+^ -]*", rule["dw"]))
    except (KeyError, TypeError, ValueError, AttributeError):
        return False
