"""The results of `lava-vpr bench` as JSON values, with a list of those missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from lava_vpr.bench.anchors import ANCHORS
from lava_vpr.bench.modelling import constants
from lava_vpr.bench.results import Bench, Measured, Peer, SweepPoint
from lava_vpr.matching.evaluation import Metrics

PERCENTILES = (50, 95, 99)

COUNTS = (
    "synaptic_operations",
    "neuron_updates",
    "input_spikes",
    "exc_spikes",
    "inh_spikes",
    "messages",
    "hops",
    "steps",
)
"""Events per query that the JSON always has; null if not counted."""


def percentiles(measured: Measured) -> dict[str, float] | None:
    """Latency of single queries in ms, p50 to p99; None: not measured."""
    if not measured.milliseconds:
        return None
    values = np.percentile(measured.milliseconds, PERCENTILES)
    return {f"p{q}": float(value) for q, value in zip(PERCENTILES, values, strict=True)}


def counts(bench: Bench) -> dict[str, float | None]:
    """Events per query on the first board with a plan, or else in the host engine."""
    mapped = next((costs.counts for costs in bench.targets.values() if costs.counts), bench.events)
    return {name: mapped.get(name) for name in COUNTS} | {
        name: value for name, value in mapped.items() if name not in COUNTS
    }


def absent(bench: Bench) -> list[dict[str, str]]:
    """The figures missing from this report, as ``what`` and ``reason``."""
    rows = [(f"{row.name}, measured", row.absent) for row in bench.measured]
    without: dict[str, list[str]] = {}
    for row in bench.measured:
        if row.no_energy and not row.absent:
            without.setdefault(row.no_energy, []).append(row.name)
    rows += [(f"energy of {', '.join(names)}, measured", reason) for reason, names in without.items()]
    rows += [(f"{name}, modelled energy and time", row.unavailable or "") for name, row in bench.targets.items()]
    if bench.workload is None and "workload" not in bench.failed:
        rows += [("workload metrics", "they are defined on integer networks; this model is a float one")]
    if not bench.peers and "peers" not in bench.failed:
        rows += [("peers", "not asked for; --peers runs them")]
    if not bench.sweep and "sweep" not in bench.failed:
        rows += [("sweep of settings", "not asked for; --sweep runs it")]
    rows += bench.failed.items()
    return [{"what": what, "reason": reason} for what, reason in rows if reason]


def as_json(bench: Bench) -> dict[str, Any]:
    """The whole run; NaN and values not computed are null; no value is a path or a date."""
    values = {
        "model": bench.model,
        "queries": bench.images,
        "recall": bench.recall,
        "probability": {name: found.as_json() for name, found in bench.trust.items()},
        "position_error": None if bench.on_map is None else bench.on_map.errors.as_json(),
        "query_pixels": bench.pixels,
        "energy": {way.name: way.as_json() for way in bench.energy} or None,
        "measured": {row.name: _timing(row) for row in bench.measured},
        "modelled": {name: row.as_json() for name, row in bench.targets.items()},
        "counts": counts(bench),
        "workload": bench.workload,
        "asked": bench.asked,
        **({} if bench.gains is None else {"gains": bench.gains}),
        **({"front_end": {k: costs.as_json() for k, costs in bench.front_end.items()}} if bench.front_end else {}),
        "peers": {row.name: _row(row, metrics="recall") for row in bench.peers} or None,
        "sweep": [_row(row, **_CANDIDATE) for row in bench.sweep] or None,
        "constants": {row.name: {key: getattr(row, key) for key in _CONSTANT} for row in constants()},
        "anchors": ANCHORS,
        "assumptions": assumptions(bench),
        "absent": absent(bench),
        "machine": bench.machine,
        "command": bench.command,
    }
    return dict(_plain(values))


def assumptions(bench: Bench) -> list[str]:
    """The assumptions of the cost model on all boards, each once."""
    return list(dict.fromkeys(text for costs in bench.targets.values() for text in costs.assumptions))


_CANDIDATE = {
    "metrics": "recall",
    "microjoules": "modelled_microjoules",
    "milliseconds": "modelled_milliseconds",
}
_CONSTANT = ("what", "low", "nominal", "high", "unit", "source")


def _timing(backend: Measured) -> dict[str, Any]:
    """A row of ``measured``: latencies as percentiles."""
    return _row(backend, milliseconds="milliseconds_per_query") | {"milliseconds_per_query": percentiles(backend)}


def _row(row: Measured | Peer | SweepPoint, **keys: str) -> dict[str, Any]:
    """The fields of a row without ``name``, those in ``keys`` under another key; empty texts are null."""
    values = {keys.get(item.name, item.name): getattr(row, item.name) for item in fields(row) if item.name != "name"}
    return {key: None if value == "" else value for key, value in values.items()}


def _plain(value: Any) -> Any:
    """``value`` in JSON types: rows and estimates become objects, arrays lists, NaN and infinity null."""
    if isinstance(value, Metrics):
        return _plain(value.as_json())
    if is_dataclass(value):
        return {item.name: _plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
