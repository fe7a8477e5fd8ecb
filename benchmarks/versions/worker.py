"""Times the host engine of a checkout when it is told to: python worker.py CASES (`benchmarks.versions.beside`).

It runs in the Python of this checkout or of an older one, whose folder is on its path, and asks only for what both
have. A line with the number of a case is read, and what it took is printed as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

from benchmarks.places import encoded, learn
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.encoding import query_rates16
from lava_vpr.engine.inference.fixed import count_spikes
from lava_vpr.engine.random import presentation_keys
from lava_vpr.model import Model, integer_model

NEEDED = ("input_spikes", "exc_spikes")


@dataclass(frozen=True)
class VersionCase:
    """What is learned and presented: a preset's places, by ``encoder`` (JSON), in so many steps with input."""

    preset: str
    encoder: str
    places: int
    steps: int
    regular: bool


@cache
def learned(name: str, encoder: str, places: int) -> Model:
    """The model that this checkout's preset learns of the first ``places`` places."""
    return learn((0, places), update(preset(name), {"encoder": json.loads(encoder)}))


def runner(case: VersionCase) -> Callable[[], dict[str, float]]:
    """A function that presents all queries once and says what that took, and which spikes there were a query."""
    model = learned(case.preset, case.encoder, case.places)
    network = integer_model(model, "timing").network
    # Checkouts before `FixedNetwork.regular` have regular trains where inputs integrate a bias, and only there.
    trains: dict[str, Any] = {"regular": case.regular, "bias_input": False}
    if "regular" not in {field.name for field in fields(network)}:
        trains = {"bias_input": case.regular}
    network = replace(network, steps=case.steps, **trains)
    winter = encoded("winter", model.config.encoder)
    rates = query_rates16(winter.activity, model.config.encoder)
    keys = presentation_keys(0, "query", winter.indices)

    def run() -> dict[str, float]:
        began = time.process_time()
        _, events, _ = count_spikes(network, rates, keys)
        taken = time.process_time() - began
        return {"seconds": taken / len(keys)} | {name: events[name] / len(keys) for name in NEEDED}

    return run


def main(text: str) -> None:
    """Run a case for each number that is read, and print what it took."""
    runs = [runner(VersionCase(**case)) for case in json.loads(text)]
    for line in sys.stdin:
        print(json.dumps(runs[int(line)]()), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
