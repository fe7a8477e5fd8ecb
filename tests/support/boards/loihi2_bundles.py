"""Small bundles for Loihi 2, made of random networks, and their programs as children.

Used by bench, benchmarks, deploy and processes.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from support.boards import host_programs
from support.common import children
from support.lava.small_networks import random_bias

from lava_vpr.deploy.bundle import loihi2, loihi2_pixels
from lava_vpr.deploy.bundle.folder import array_bytes
from lava_vpr.engine.inference.fixed import FixedNetwork, silent_steps
from lava_vpr.engine.inference.whole import WholeNetwork, counts_of
from lava_vpr.engine.random import presentation_keys
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.loihi import INPUT_SHIFT

STANDIN = Path(__file__).parents[1] / "standins" / "loihi2"
AGAIN = "; deploy the model again or fetch an intact copy"
IMAGES, PLACES, INTERVAL = 5, 4, 32
SPEC = FrontEnd(width=8, levels=14, race=8, budget=40, reading=12)
"""A small front end whose cells are heard: a presentation of 39 steps takes 64."""


def network(seed: int = 0, inputs: int = 24, neurons: int = 10, **changes: Any) -> FixedNetwork:
    """A small network whose neurons spike; bias inputs are regular."""
    numbers = {"bits": 3, "signed": False, "threshold": 20, "inhibition": 10, "inhibition_exponent": 0, "decay": 137}
    numbers |= {"regular": changes.get("bias_input", False), "bias_input": False} | changes
    rng = np.random.default_rng(seed)
    weights = rng.random((inputs, neurons)) ** 4 * (1 << numbers["bits"])
    if numbers["signed"]:
        weights *= rng.choice([-1, 1], weights.shape, p=[0.2, 0.8])
    numbers = {"steps": INTERVAL - silent_steps(neurons, numbers["bias_input"])} | numbers
    plain = FixedNetwork(weights.astype(np.int16), np.zeros(neurons, np.int32), **numbers)
    return replace(plain, bias=random_bias(rng, plain))


def queries(inputs: int = 24, n: int = IMAGES, seed: int = 0) -> tuple[NDArray[np.uint16], NDArray[np.uint64]]:
    """Rates that bring six spikes a step, and keys."""
    activity = np.random.default_rng(seed).random((n, inputs)) ** 3
    share = activity / activity.sum(axis=1, keepdims=True)
    return np.minimum(share * 6 * 65536, 65535).astype(np.uint16), presentation_keys(1, "response", np.arange(n))


def write_bundle(path: Path, net: FixedNetwork) -> Path:
    """A bundle of ``net`` with its references: the first place has two images."""
    labels = np.arange(IMAGES) % PLACES
    return host_programs.write_bundle(path, "loihi2", net, loihi2.network_files(net), queries(net.inputs), labels).path


def hearing(spec: FrontEnd = SPEC, seed: int = 2, neurons: int = 7, **changes: Any) -> WholeNetwork:
    """``spec`` with a network whose neurons spike, inhibit each other, and have biases."""
    rng = np.random.default_rng(seed)
    made = FixedNetwork(
        weights=rng.integers(-7, 8, (spec.populations["cells"], neurons)).astype(np.int16),
        bias=(rng.integers(-60, 1, neurons) << INPUT_SHIFT).astype(np.int32),
        bits=3,
        signed=True,
        threshold=20,
        inhibition=3,
        inhibition_exponent=4,
        decay=4095,
        steps=spec.ticks,
        regular=True,
        rising=spec.rising,
        rise=1,
    )
    made = replace(made, **changes)
    made.check()
    return WholeNetwork.of(spec, made)


def pictures(n: int, seed: int = 0, spec: FrontEnd = SPEC) -> NDArray[np.uint8]:
    """Random pictures, the last of one grey level."""
    drawn = np.random.default_rng(seed).integers(0, 256, (n, spec.height, spec.width)).astype(np.uint8)
    drawn[-1] = 90
    return drawn


def write_pixels_bundle(path: Path, whole: WholeNetwork | None = None) -> Path:
    """A bundle that takes pixels, with five pictures and the counts that they must give."""
    whole = whole or hearing()
    files, facts = loihi2_pixels.whole_files(whole)
    shown = pictures(IMAGES, spec=whole)
    own = {"host/pixels.npy": array_bytes(shown), "host/counts.npy": array_bytes(counts_of(whole, shown))}
    bursts = np.array([whole.burst_codes(whole.bursts_of(one)).ravel() for one in shown])
    given = bursts, np.zeros(IMAGES, np.uint64)
    made = host_programs.write_bundle(
        path, "loihi2", whole.places, {**files, **own}, given, np.arange(IMAGES), front_end=facts
    )
    return made.path


def environment(standin: Path | None = STANDIN, options: Path | None = None) -> dict[str, str]:
    """For a program: with the stand-in on its path and a host configured, or without both."""
    dropped = ("PYTHONPATH", "SLURM", "NXSDKHOST", "STANDIN_LOIHI")
    own = {key: value for key, value in os.environ.items() if key not in dropped}
    if standin is not None:
        own |= {"PYTHONPATH": str(standin), "NXSDKHOST": "10.0.0.2"}
    return own | ({"STANDIN_LOIHI": str(options)} if options is not None else {})


def program(bundle: Path, *words: object, env: dict[str, str] | None = None) -> tuple[int, str]:
    """Run a bundle's program; exit code and what it says."""
    command = [sys.executable, str(bundle / "program" / "run.py"), *map(str, words)]
    ran = children.run(command, env=env or environment(None), capture_output=True, text=True, timeout=120, check=False)
    return ran.returncode, (ran.stdout + ran.stderr).strip()


def asked(folder: Path, **options: Any) -> Path:
    """The stand-in's options, in a file."""
    path = folder / "standin.json"
    path.write_text(json.dumps(options), encoding="utf-8")
    return path
