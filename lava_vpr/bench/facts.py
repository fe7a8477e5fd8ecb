"""What figures of a run are to be read with: model, processor and software."""

from __future__ import annotations

import importlib.metadata
import platform
from pathlib import Path

from lava_vpr import __version__
from lava_vpr.engine.presentations import cores
from lava_vpr.model import Model


def model_facts(model: Model, decoder: str) -> dict[str, object]:
    """Figures of the model that the others are to be read with."""
    return {
        "preset": model.config.preset,
        "places": model.places,
        "neurons": model.neurons,
        "inputs": model.config.encoder.inputs,
        "weight_bits": model.weight_bits,
        "steps": model.config.network.steps,
        "input_spikes_per_step": model.config.encoder.query_spikes,
        "decoder": decoder,
    }


def machine(cpuinfo: Path = Path("/proc/cpuinfo")) -> dict[str, object]:
    """Processor and software that the measured figures belong to."""
    try:
        lines = cpuinfo.read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    facts: dict[str, object] = {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "processors": cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "lava_vpr": __version__,
    }
    for package in ("numpy", "numba", "lava-nc"):
        try:
            facts[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            facts[package] = None
    return facts
