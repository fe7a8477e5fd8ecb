"""Checkpoints: what a training goes on from.

Used by storage and support.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from support.fuzz.soundness.parsing import container_of
from support.fuzz.soundness.rules import Findings, whole


def check_checkpoint(data: bytes, told: dict[str, Any]) -> Findings:
    """The rules that a checkpoint breaks.

    Args:
        data: The file.
        told: Of the training that goes on from it: ``fingerprint``, ``config`` as nested dictionaries, ``shapes``, the
            type and shape of every array of each stretch's trainer, and ``images``, which a stretch's epoch shows.
    """
    findings = Findings()
    header, arrays = container_of(data, "checkpoint", findings)
    if findings:
        return findings
    config, shapes = told["config"], told["shapes"]
    findings.need(header.get("fingerprint") == told["fingerprint"], "C1", f"{header.get('fingerprint')!r:.40}")
    epochs = header.get("epochs")
    if not findings.need(isinstance(epochs, dict), "C2", "no epochs") or not isinstance(epochs, dict):
        return findings
    most = config["learning"]["epochs"]
    for number, done in epochs.items():
        findings.need(number in {str(k) for k in range(len(shapes))}, "C2", f"stretch {number!r:.30}")
        findings.need(whole(done, 1, most), "C2", f"{done!r:.30} epochs of {most}")
    if findings:
        return findings
    expected = {f"{k}.{name}": fits for k in epochs for name, fits in shapes[int(k)].items()}
    findings.need(set(arrays) == set(expected), "C3", f"{sorted(set(arrays) ^ set(expected))[:3]}")
    for name, (kind, shape) in expected.items():
        array = arrays.get(name)
        if array is None:
            continue
        fits = array.dtype == np.dtype(kind) and array.shape == tuple(shape)
        if findings.need(fits, "C3", f"{name} is {array.dtype} {array.shape}"):
            _values(name.split(".")[1], array, config, told["images"], findings)
    return findings


def _values(name: str, array: Any, config: dict[str, Any], images: int, findings: Findings) -> None:
    """C4 of one array."""
    learning, network = config["learning"], config["network"]
    if array.dtype.kind == "f" and not findings.need(np.isfinite(array).all(), "C4", f"{name} not finite"):
        return
    low, high = 0.0, float("inf")
    if name == "weights":
        # Normalisation may bring one weight above w_max, at most to the whole sum of its neuron's.
        high = max(learning["w_max"], learning.get("mean_weight", 0) * len(array), learning.get("weight_sum", 0))
        high = high if array.dtype.kind == "f" else 255
    elif name == "theta" and array.dtype.kind in "iu":
        low, high = 1, (1 << 17) - 1
    elif name == "delays":
        high = network["delay_max_ms"] / network["dt_ms"] + 0.5
    elif name == "responses":
        high = images * min(learning["label_epochs"], learning["epochs"]) * network["steps"]
    sound = bool(((array >= low) & (array <= high * (1 + 1e-6))).all())
    findings.need(sound, "C4", f"{name} from {array.min(initial=0)} to {array.max(initial=0)}, not {low} to {high}")
