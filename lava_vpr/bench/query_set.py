"""The queries of a run, prepared for every stage, and the facts about model and machine that its figures depend on."""

from __future__ import annotations

import importlib.metadata
import platform
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr import __version__
from lava_vpr.backends.interface import HostBackend, Presentations, query_presentations
from lava_vpr.cluster.tasks import Pool
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.presentations import Trains, cores
from lava_vpr.model import Model


@dataclass(frozen=True)
class QuerySet:
    """The queries of a run, and the model that is asked.

    Attributes:
        model: The model that is asked.
        images: The query images, encoded with its settings.
        shown: The presentations that every backend is shown of them: input rates and noise.
    """

    model: Model = field(repr=False)
    images: EncodedTraverse = field(repr=False)
    shown: Presentations = field(repr=False)

    @classmethod
    def of(cls, model: Model, images: EncodedTraverse, seed: int | None = None) -> QuerySet:
        """The queries ``images`` to ``model``, with the noise of ``seed``; None: of the model's own.

        Raises:
            InputError: the queries were encoded with other settings.
        """
        return cls(model, images, query_presentations(model, images, seed))

    def __len__(self) -> int:
        return len(self.images)

    def trains(self, chosen: slice | NDArray[np.int64]) -> Trains:
        """Every spike of the queries ``chosen``, by the host engine.

        Raises:
            ConfigError: the model has no integer network.
        """
        return HostBackend(Pool(cores())).trains(self.model, self.shown.part(chosen))


def model_facts(model: Model, decoder: str) -> dict[str, object]:
    """Figures of the model that describe the run: places, neurons, bits, steps."""
    return {
        "preset": model.config.preset,
        "places": model.places,
        "neurons": model.neurons,
        "inputs": model.config.encoder.inputs,
        "weight_bits": model.weight_bits,
        "steps": model.config.steps,
        "input_spikes_per_step": model.config.encoder.query_spikes,
        "decoder": decoder,
    }


def machine(cpuinfo: Path = Path("/proc/cpuinfo")) -> dict[str, object]:
    """Processor and software with which the figures were measured."""
    try:
        lines = cpuinfo.read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    facts = {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "processors": cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "lava_vpr": __version__,
    }
    return facts | {package: installed(package) for package in ("numpy", "numba", "lava-nc")}


def installed(package: str) -> str | None:
    """Installed version of a distribution, or None."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
