"""What tests/processes/test_bias_inputs.py lets a worker call: runs of Lava with inputs that integrate a bias.

Used by processes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.process.ports.ports import InPort, OutPort
from numpy.typing import NDArray

from lava_vpr.processes.bias_inputs.process import BiasInputs
from lava_vpr.processes.jobs import inference as jobs

Arrays = dict[str, NDArray[Any]]


def _run(job: str, arrays: Arrays, options: dict[str, Any], name: str) -> Arrays:
    """The results of a job, their names begun with ``name``."""
    got = getattr(jobs, job)(arrays, options)
    return {f"{name}_{key}": value for key, value in got.items()}


def networks(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Every network of ``options["networks"]`` in its ``options["runs"]``, pairs of job and tag; with rasters."""
    results: Arrays = {}
    for name, own in options["networks"].items():
        given = {key: arrays[f"{name}_{key}"] for key in ("weights", "bias", "rates", "keys")}
        for job, tag in options["runs"][name]:
            results |= _run(job, given, {**own, "tag": tag, "record": True}, f"{name}_{job}_{tag}")
    return results | _as_on_a_board(arrays, options)


def _as_on_a_board(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The library's first network, wired as for a board but simulated; which ports would have crossed adapters."""
    crossed: list[str] = []
    across, begin, written = jobs.across, jobs.begin, BiasInputs.write
    calls: list[int] = []

    def direct(source: OutPort, target: InPort, adapter: str | None) -> None:
        crossed.append(f"{type(source.process).__name__}.{source.name} {adapter}")
        across(source, target, None)

    def write(self: BiasInputs, presentation: int) -> None:
        written(self, presentation)
        calls.append(self.sent)

    name, own = next(iter(options["networks"].items()))
    given = {key: arrays[f"{name}_{key}"] for key in ("weights", "bias", "rates", "keys")}
    given["rates"][1] = given["rates"][0]  # nothing but v differs, so nothing else is written
    jobs.across, jobs.begin = direct, lambda process, way: begin(process, way._replace(board=False))
    BiasInputs.write = write  # type: ignore[method-assign]
    try:
        results = _run("library", given, {**own, "tag": "fixed_pt", "board": True}, "board")
    finally:
        jobs.across, jobs.begin = across, begin
        BiasInputs.write = written  # type: ignore[method-assign]
    return results | {"crossed": np.array(crossed), "writes": np.diff(calls, prepend=0)}
