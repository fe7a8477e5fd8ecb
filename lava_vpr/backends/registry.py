"""The one registry of backends: a name and an object that counts spikes.

Every backend runs the model's own network spec and has no parameters of its own; equal model, rates and seed give equal
counts, bit for bit, on every fixed-point backend.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lava_vpr.configfile import to_dict
from lava_vpr.encoding import draw_trains
from lava_vpr.engine.conductance import model as conductance
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import SILENT_STEPS, FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.trains import Trains
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.model import Model, checked_network

Advance = Callable[[int], None]
SLOWEST = 40.0
"""Steps per second of Lava that are still taken for progress; what takes longer, and two minutes, is ended."""


class Backend(Protocol):
    """Counts spikes of a model's excitatory neurons."""

    def count_spikes(
        self,
        model: Model,
        rates: NDArray[Any],
        *,
        image_ids: NDArray[np.int64],
        role: str,
        seed: int,
    ) -> tuple[NDArray[np.int32], dict[str, int]]:
        """Present ``rates`` (n, inputs).

        Returns:
            Counts int (n, neurons), and the events of the run, summed.
        """
        ...

    def trains(
        self, model: Model, rates: NDArray[Any], *, image_ids: NDArray[np.int64], role: str, seed: int
    ) -> Trains:
        """The same presentations, every spike of the integer network.

        Raises:
            BackendUnavailableError: one of `COUNTING`.
        """
        ...


class HostBackend:
    """The compiled engine on this machine's processor."""

    def __init__(self, threads: int = 1) -> None:
        self.threads = threads

    def count_spikes(
        self,
        model: Model,
        rates: NDArray[Any],
        *,
        image_ids: NDArray[np.int64],
        role: str,
        seed: int,
    ) -> tuple[NDArray[np.int32], dict[str, int]]:
        """See `Backend.count_spikes`; the result does not depend on the number of threads."""
        keys = presentation_keys(seed, role, image_ids)
        if isinstance(model.network, ConductanceState):
            return conductance.count_spikes(model.network, rates, keys, model.config, threads=self.threads)
        counts, events, _ = fixed.count_spikes(checked_network(model, "host"), rates, keys, threads=self.threads)
        return counts, events

    def trains(
        self, model: Model, rates: NDArray[Any], *, image_ids: NDArray[np.int64], role: str, seed: int
    ) -> Trains:
        """See `Backend.trains`. A relay fires one step after its neuron, so its train is that one, shifted."""
        network = checked_network(model, "host")
        keys = presentation_keys(seed, role, image_ids)
        _, _, exc = fixed.count_spikes(network, rates, keys, threads=self.threads, raster=True)
        total = network.steps + SILENT_STEPS
        inputs = draw_trains(rates, keys, network.steps, total, bias_input=network.bias_input)
        inh = np.zeros_like(exc)
        inh[:, 1:] = exc[:, :-1]
        return Trains(exc, inputs, inh)


@dataclass(frozen=True)
class LavaBackend:
    """The network as Lava Processes, in a child process that can be killed.

    Attributes:
        name: Of the backend.
        job: Function of `lava_vpr.processes.jobs.inference` that wires and runs the network.
        tag: Which ProcessModels: ``fixed_pt`` or ``floating_pt``.
        board: Run on a Loihi 2 board.
        advance: Told how many presentations are done.
    """

    name: str
    job: str
    tag: str = "fixed_pt"
    board: bool = False
    advance: Advance | None = None

    def count_spikes(
        self,
        model: Model,
        rates: NDArray[Any],
        *,
        image_ids: NDArray[np.int64],
        role: str,
        seed: int,
    ) -> tuple[NDArray[np.int32], dict[str, int]]:
        """See `Backend.count_spikes`."""
        keys = presentation_keys(seed, role, image_ids)
        if isinstance(model.network, ConductanceState) and self.name == "lava-float":
            return self._conductance(model.network, rates, keys, model.config)
        network = checked_network(model, self.name)
        results = self._run(network, rates, keys, record=False)
        counts = results["counts"].astype(np.int32)
        if "events" in results:
            return counts, dict(zip(fixed.EVENTS, (int(x) for x in results["events"]), strict=True))
        per_input = results["input_spikes"]
        operations, input_spikes = int(per_input @ network.prepared[1]), int(per_input.sum())
        return counts, fixed.named_events(network, operations, input_spikes, int(counts.sum()), len(rates))

    def trains(
        self, model: Model, rates: NDArray[Any], *, image_ids: NDArray[np.int64], role: str, seed: int
    ) -> Trains:
        """See `Backend.trains`."""
        network = checked_network(model, self.name)
        results = self._run(network, rates, presentation_keys(seed, role, image_ids), record=True)
        return Trains(**{name: results[name] for name in Trains.POPULATIONS if name in results})

    def timed(
        self, model: Model, rates: NDArray[Any], *, image_ids: NDArray[np.int64], role: str, seed: int, single: bool
    ) -> tuple[NDArray[np.int32], NDArray[np.float64], int | None]:
        """Counts (n, neurons); when Lava ran, float64 (runs, 3); and the bytes that its processes held together.

        A row is presentations, begin and end (`time.monotonic`); the first run includes what Lava compiles and starts.
        With ``single`` every run is one presentation.
        """
        network = checked_network(model, self.name)
        keys, timed = presentation_keys(seed, role, image_ids), "single" if single else "runs"
        results = self._run(network, rates, keys, record=False, timed=timed)
        return results["counts"].astype(np.int32), results["runs"], int(results["held"][0]) or None

    def _run(
        self,
        network: FixedNetwork,
        rates: NDArray[np.uint16],
        keys: NDArray[np.uint64],
        *,
        record: bool,
        timed: str = "",
    ) -> dict[str, NDArray[Any]]:
        """Run the job on every presentation."""
        from lava_vpr.isolated.runner import run_isolated  # Lava is imported only where it is used

        options: dict[str, Any] = network.scalars | {
            "tag": self.tag,
            "record": record,
            "board": self.board,
            "timed": timed,
        }
        arrays: dict[str, NDArray[Any]] = {"weights": network.weights, "rates": rates.astype(np.uint16), "keys": keys}
        steps = len(rates) * (network.steps + SILENT_STEPS)
        timeout = 120 + steps / SLOWEST
        job = f"lava_vpr.processes.jobs.inference:{self.job}"
        return run_isolated(job, arrays, options, timeout=timeout, progress=self.advance)

    def _conductance(
        self, network: ConductanceState, rates: NDArray[np.uint32], keys: NDArray[np.uint64], config: Any
    ) -> tuple[NDArray[np.int32], dict[str, int]]:
        """The ``paper`` preset's network as float Processes."""
        from lava_vpr.isolated.runner import run_isolated

        arrays: dict[str, NDArray[Any]] = {
            "weights": network.weights,
            "theta_mv": network.theta_mv,
            "delays": network.delays,
            "rates": rates,
            "keys": keys,
        }
        steps = len(rates) * (config.network.steps + config.network.rest_steps)
        results = run_isolated(
            "lava_vpr.processes.jobs.conductance:conductance",
            arrays,
            {"config": to_dict(config)},
            timeout=120 + steps / SLOWEST,
            progress=self.advance,
        )
        constants = conductance.constants(config, learn=False)
        events = conductance.named_events(results["events"], len(network.theta_mv), len(rates), constants)
        return results["counts"].astype(np.int32), events


BACKENDS: dict[str, str] = {
    "host": "compiled engine on this machine's processor, bit-exact integers",
    "lava-fixed": "Lava Processes in Loihi's integers, Loihi 2 simulation configuration",
    "lava-float": "the same Processes in floating point; preset paper, too",
    "lava-fused": "one Lava Process with the compiled engine, a presentation of many queries a step",
    "lava-library": "wired from Lava's own LIF, Dense and Sparse alone: what Intel's compiler can place",
    "bundle": "registers and memory of a deployed bundle, simulated (a model is deployed for Kapoho Bay first)",
    "loihi2": "the library's network on a Loihi 2 board",
    "kapoho-bay": "a bundle on Kapoho Bay, by Intel's NxSDK",
}

DEPLOYED = ("bundle", "kapoho-bay")
"""Backends that run a bundle."""

COUNTING = ("kapoho-bay",)
"""Backends that tell spike counts only: no board reads out single spikes without slowing down."""

_LAVA = {
    "lava-fixed": LavaBackend("lava-fixed", "composed"),
    "lava-float": LavaBackend("lava-float", "composed", tag="floating_pt"),
    "lava-fused": LavaBackend("lava-fused", "fused"),
    "lava-library": LavaBackend("lava-library", "library"),
    "loihi2": LavaBackend("loihi2", "library", board=True),
}


def unavailable(name: str) -> str | None:
    """Why the backend called ``name`` cannot run here, and what to do; None if it can."""
    if name not in BACKENDS:
        return f"there is no backend {name!r}; choose from {', '.join(BACKENDS)}"
    if name == "host":
        return None
    if name in DEPLOYED:
        from lava_vpr.backends import deployed

        return deployed.unavailable(name)
    from lava_vpr.processes.base.lava_checks import loihi_available, require_lava

    try:
        require_lava()
    except BackendUnavailableError as error:
        return str(error)
    reason = loihi_available() if name == "loihi2" else None
    return f"{reason}; --backend lava-library simulates the same network" if reason else None


def require(name: str, model: Model | None = None) -> None:
    """Refuse a backend that cannot run here, or not ``model``, before any work is done.

    Raises:
        BackendUnavailableError: unknown, or its software or device is missing.
        ConfigError: it runs no such network.
    """
    reason = unavailable(name)
    if reason is not None:
        raise BackendUnavailableError(reason)
    if model is None:
        return
    if name in DEPLOYED or (model.bundle is not None and name == "loihi2"):
        from lava_vpr.backends import deployed

        deployed.refuse(name, model)
    if name not in ("host", "lava-float"):
        checked_network(model, name)


def get(name: str, threads: int = 1, advance: Advance | None = None) -> Backend:
    """The backend called ``name``; ``advance`` is told how many presentations are done by those that are slow.

    Raises:
        BackendUnavailableError: unknown, or its software or device is missing.
    """
    require(name)
    if name in DEPLOYED:
        from lava_vpr.backends import deployed

        return deployed.KapohoBayBackend(advance) if name == "kapoho-bay" else deployed.BundleBackend(advance)
    return HostBackend(threads) if name == "host" else replace(_LAVA[name], advance=advance)
