"""Model files: every part by itself, and whether the parts fit each other.

Used by storage and support.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from support.fuzz.soundness import settings
from support.fuzz.soundness.parsing import container_of
from support.fuzz.soundness.rules import Findings, whole

Arrays = Mapping[str, NDArray[Any]]
NUMBERS = {
    "bits": (1, 8),
    "signed": (0, 1),
    "threshold": (1, (1 << 17) - 1),
    "inhibition": (0, 255),
    "inhibition_exponent": (0, 7),
    "decay": (0, 4096),
    "steps": (1, 65_535),
    "regular": (0, 1),
    "bias_input": (0, 1),
}
SUM_LIMIT = 1 << 17
VALUES = ("learned", "responses", "place_indices", "labels", "patches", "activity", "thumbnails")


def numbers(said: Any, findings: Findings) -> bool:
    """M3 for the numbers ``said`` of a network; whether they can be used further."""
    if not findings.need(isinstance(said, dict), "M3", "no numbers of the network"):
        return False
    sound = True
    for name, (low, high) in NUMBERS.items():
        value = said.get(name)
        sound &= findings.need(whole(value, low, high), "M3", f"{name} is {value!r:.40}")
    if sound:
        sound &= findings.need(said["bits"] + said["signed"] <= 8, "M3", "more than 8 bits with the sign")
        sound &= findings.need(said["regular"] >= said["bias_input"], "M3", "biases that make no regular trains")
    return sound


def silence(neurons: int, bias_input: int) -> int:
    """Steps without input: to exc, in between through relays; to each of one or two inhibitory neurons; and back."""
    return (2 if neurons > 1024 and not bias_input else 1) + (2 if neurons > 4096 else 1) + 1


def as_set(said: Mapping[str, int], neurons: int, config: Mapping[str, Any], findings: Findings) -> None:
    """M3: the network is the one of the settings."""
    network = config["network"]
    modes = (int(network["signed"]), int(network["trains"] == "regular"), int(network["input_mode"] == "bias"))
    told = (network["steps"], network["weight_bits"], *modes)
    interval = said["steps"] + silence(neurons, said["bias_input"])
    own = (interval, said["bits"], said["signed"], said["regular"], said["bias_input"])
    findings.need(own == told, "M3", f"steps, bits, sign, trains and input mode {own}, but {told} in the settings")


def sums(weights: NDArray[Any], said: Mapping[str, int], findings: Findings) -> None:
    """M2 and M4 of an integer network's weights."""
    if not findings.need(
        weights.dtype == np.int16 and weights.ndim == 2, "M2", f"weights {weights.dtype} {weights.shape}"
    ):
        return
    findings.need(weights.shape[1] >= 1, "M2", "no neurons")
    exact = weights.astype(np.int64)
    least, most = int(exact.min(initial=0)), int(exact.max(initial=0))
    findings.need(max(-least, most) < 1 << said["bits"], "M2", f"weights {least} to {most} in {said['bits']} bits")
    findings.need(said["signed"] or least >= 0, "M2", f"a weight of {least} without a sign")
    up = int(np.where(exact > 0, exact, 0).sum(axis=0).max(initial=0))
    down = -int(np.where(exact < 0, exact, 0).sum(axis=0).min(initial=0))
    findings.need(up < SUM_LIMIT, "M4", f"weights that sum to {up}")
    down += said["inhibition"] << said["inhibition_exponent"]
    findings.need(down < SUM_LIMIT, "M4", f"weights and inhibition that take {down}")


def biases(bias: NDArray[Any] | None, neurons: int, said: Mapping[str, int], findings: Findings) -> None:
    """M2 of an integer network's biases."""
    if not _is(bias, "i4", (neurons,), "M2", "bias", findings) or bias is None:
        return
    values = [int(value) for value in bias]
    one = any(all(v % (1 << e) == 0 and abs(v) >> e < 4096 for v in values) for e in range(8))
    findings.need(one, "M2", f"biases {values[:4]} that 12 bits and one exponent do not hold")
    highest = said["threshold"] * 64 * said["decay"] // 4096
    findings.need(max(values, default=0) <= highest, "M2", f"a bias of {max(values, default=0)}, above {highest}")


def check_model(data: bytes, view: Mapping[str, Any]) -> Findings:
    """The rules that a model file breaks.

    Args:
        data: The file.
        view: What the reader made of it: ``config`` as nested dictionaries, ``arrays`` by their names in the file,
            ``names``, ``route_images``, ``stretches`` and, for an integer network, ``numbers``.
    """
    findings = Findings()
    header, arrays = container_of(data, "model", findings)
    if findings:
        return findings
    config = dict(view["config"])
    if not settings.check(config, findings):
        return findings
    settings.as_said(header.get("config"), config, findings)
    inputs = settings.inputs_of(config)
    if config["network"]["model"] == "lif":
        weights = arrays.get("network.weights")
        if findings.need(weights is not None, "M2", "no weights") and weights is not None:
            shape: tuple[int, ...] = weights.shape
            said, neurons = header.get("fixed"), shape[-1] if len(shape) == 2 else -1
            if numbers(said, findings):
                sums(weights, said, findings)
                biases(arrays.get("network.bias"), neurons, said, findings)
                findings.need(view["numbers"] == said, "M14", f"{view['numbers']}")
                as_set(said, neurons, config, findings)
            findings.need(shape[:1] == (inputs,), "M2", f"weights {shape} of {inputs} inputs")
            references(header, arrays, config, shape, findings)
            _learned(arrays, shape, config, findings)
    else:
        shape = _conductance(arrays, config, inputs, findings)
        references(header, arrays, config, shape, findings)
        _learned(arrays, None, config, findings)
    as_returned(header, arrays, view, findings)
    return findings


def _positions(frame: object, positions: Any, places: int, findings: Findings) -> None:
    """M15: where the places are."""
    if frame is None and positions is None:
        return
    known = frame in ("xy", "latlon") or frame in [f"UTM {zone}{side}" for zone in range(1, 61) for side in "NS"]
    if not findings.need(known and positions is not None, "M15", f"frame {frame!r:.40}"):
        return
    if _is(positions, "f8", (places, 2), "M15", "positions", findings):
        first, second = (90, 360) if frame == "latlon" else (1 << 53, 1 << 53)
        within = all(abs(a) <= first and abs(b) <= second for a, b in positions.tolist())
        findings.need(within, "M15", f"positions beyond {frame}")


def _learned(arrays: Arrays, shape: tuple[int, ...] | None, config: Any, findings: Findings) -> None:
    """M11; what gradients learned has either sign."""
    learned = arrays.get("learned")
    if not findings.need(learned is not None, "M11", "no learned weights") or learned is None:
        return
    fits = learned.shape == (0, 0) or (shape is not None and learned.shape == shape)
    findings.need(learned.dtype == np.float32 and fits, "M11", f"learned {learned.dtype} {learned.shape}")
    if learned.dtype.kind == "f":
        least = -np.inf if config["learning"]["rule"] == "slayer" else 0
        findings.need(
            bool((np.isfinite(learned) & (learned >= least)).all()), "M11", "learned weights beyond all bounds"
        )


def _conductance(arrays: Arrays, config: Any, inputs: int, findings: Findings) -> tuple[int, ...]:
    """M13; the shape of the weights."""
    network, learning = config["network"], config["learning"]
    shape = (inputs, network["neurons"])
    expected = {"weights": ("f8", shape), "theta_mv": ("f8", shape[1:]), "delays": ("u2", shape)}
    for name, (kind, size) in expected.items():
        array = arrays.get(f"network.{name}")
        if not findings.need(array is not None, "M13", f"no {name}") or array is None:
            continue
        fits = array.dtype == np.dtype(kind) and array.shape == size
        if not findings.need(fits, "M13", f"{name} {array.dtype} {array.shape}"):
            continue
        if name == "delays":
            longest = math.floor(network["delay_max_ms"] / network["dt_ms"] + 0.5)
            findings.need(int(array.max(initial=0)) <= longest, "M13", f"a delay of {array.max(initial=0)} steps")
            continue
        findings.need(bool(np.isfinite(array).all()), "M13", f"{name} not finite")
        if name == "weights":
            # After learning, normalisation may bring weights above w_max, up to all of the sum.
            most = max(learning["w_max"], learning["weight_sum"])
            findings.need(bool(((array >= 0) & (array <= most)).all()), "M13", f"{name} beyond 0 to {most}")
    return shape


def references(
    header: Mapping[str, Any], arrays: Arrays, config: Any, shape: tuple[int, ...], findings: Findings
) -> None:
    """M5 to M10, M12 and M15: what a model keeps of its references."""
    names = header.get("place_names")
    good = isinstance(names, list) and all(isinstance(name, str) for name in names) and len(names) >= 2
    if not findings.need(good, "M12", "no names of places") or not isinstance(names, list):
        return
    for name in names:
        findings.need(
            "\0" not in name and not any("\ud800" <= c <= "\udfff" for c in name), "M12", f"name {name!r:.40}"
        )
    figures = header.get("training")
    if findings.need(isinstance(figures, dict), "M12", "no figures of the training") and isinstance(figures, dict):
        for name, value in figures.items():
            finite = type(value) in (int, float) and math.isfinite(value)
            findings.need(finite, "M12", f"figure {name!r:.20} is {value!r:.40}")
    places, neurons = len(names), shape[1] if len(shape) == 2 else -1
    views = settings.views_of(config)
    _stretches(header.get("stretches"), places, neurons, views, config["network"], findings)
    route = header.get("route_images")
    findings.need(whole(route, places, 1 << 53), "M6", f"route_images is {route!r:.40}")
    indices = arrays.get("place_indices")
    if _is(indices, "i8", (places,), "M6", "place_indices", findings) and indices is not None:
        findings.need(len(set(indices.tolist())) == places, "M6", "places with equal indices")
        findings.need(bool(((indices >= 0) & (indices <= 1 << 53)).all()), "M6", "indices that are none")
    _positions(header.get("frame"), arrays.get("positions"), places, findings)
    labels = arrays.get("labels")
    good = labels is not None and labels.dtype == np.int64 and labels.ndim == 1
    if not findings.need(good, "M7", "no labels") or labels is None:
        return
    shown, told = len(labels) // places, labels.tolist()
    whole_traverses = shown >= 1 and shown % views == 0
    findings.need(whole_traverses and told == [*range(places)] * shown, "M7", f"labels {told[:9]}")
    _images(arrays, len(labels), places, settings.inputs_of(config), config, findings)
    responses = arrays.get("responses")
    kind = "i4" if responses is not None and responses.dtype == np.int32 else "u2"
    if _is(responses, kind, (neurons, places), "M9", "responses", findings) and responses is not None:
        most = _most_spikes(config, len(labels) // max(1, places))
        sound = bool(((responses >= 0) & (responses <= most)).all())
        findings.need(
            sound, "M9", f"responses from {responses.min(initial=0)} to {responses.max(initial=0)}, at most {most}"
        )


def _most_spikes(config: Any, traverses: int) -> int:
    """Spikes that one neuron can have for one place."""
    learning = config["learning"]
    repeats = min(learning["label_epochs"], learning["epochs"]) if "label_epochs" in learning else 1
    return int(traverses * repeats * config["network"]["steps"])


def _stretches(parts: Any, places: int, neurons: int, views: int, network: dict[str, Any], findings: Findings) -> None:
    sizes = (5, 6) if network["model"] == "lif" else (5,)
    good = isinstance(parts, list) and len(parts) >= 1 and all(isinstance(p, list) and len(p) in sizes for p in parts)
    if not findings.need(good, "M5", f"stretches {parts!r:.40}"):
        return
    place = neuron = view = 0
    for first, size, first_neuron, count, seen, *removed in parts:
        if place == places:
            place, view = 0, view + 1
        sound = whole(first, place, place) and whole(size, 1, places) and whole(seen, view, view)
        sound = sound and whole(first_neuron, neuron, neuron) and whole(count, 0 if removed else 1, neurons)
        sound = sound and all(whole(gone, 1, 1 << 53) for gone in removed)
        if not findings.need(sound, "M5", f"stretch {first!r:.20}, {size!r:.20}, {first_neuron!r:.20}, {count!r:.20}"):
            return
        most = network["neurons"] or max(1, round(network["neurons_per_place"] * (size + sum(removed))))
        fits = count <= most if removed else count == most
        findings.need(fits, "M5", f"{count} neurons of {size} places, {removed} removed, not {most}")
        place, neuron = place + size, neuron + count
    found = (place, neuron, view)
    findings.need(found == (places, neurons, views - 1), "M5", f"stretches to place, neuron and view {found}")
    findings.need(neuron >= 1, "M5", "no neurons")
    cuts = [[(p[0], p[1], p[5:]) for p in parts if p[4] == view] for view in range(views)]
    findings.need(all(cut == cuts[0] for cut in cuts), "M5", "another cut in another view")


def _is(
    array: NDArray[Any] | None, kind: str, shape: tuple[int, ...], rule: str, name: str, findings: Findings
) -> bool:
    good = array is not None and array.dtype == np.dtype(kind) and array.shape == shape
    told = "is missing" if array is None else f"is {array.dtype} {array.shape}"
    return findings.need(good, rule, f"{name} {told}")


def _images(arrays: Arrays, images: int, places: int, inputs: int, config: Any, findings: Findings) -> None:
    _is(arrays.get("patches"), "u1", (images, 28, 28), "M10", "patches", findings)
    _is(arrays.get("thumbnails"), "u1", (places, 48, 64, 3), "M10", "thumbnails", findings)
    activity = arrays.get("activity")
    if _is(activity, "f4", (images, inputs), "M8", "activity", findings) and activity is not None:
        findings.need(bool((np.isfinite(activity) & (activity >= 0)).all()), "M8", "activity beyond all bounds")
        if config["encoder"]["kind"] == "pixels":
            findings.need(bool((activity <= 255).all()), "M8", "pixels above 255")


def as_returned(header: Mapping[str, Any], arrays: Arrays, view: Mapping[str, Any], findings: Findings) -> None:
    """M14: the reader returns what the file says."""
    for name, array in view["arrays"].items():
        own = arrays.get(name)
        same = (
            own is not None and own.dtype == array.dtype and np.array_equal(own, array, equal_nan=own.dtype.kind == "f")
        )
        findings.need(same, "M14", f"{name} is read as something else")
    findings.need(list(view["names"]) == header.get("place_names"), "M14", "names are read as something else")
    findings.need(view["route_images"] == header.get("route_images"), "M14", "route_images")
    findings.need([list(part) for part in view["stretches"]] == header.get("stretches"), "M14", "stretches")
