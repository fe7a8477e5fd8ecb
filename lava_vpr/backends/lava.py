"""Backends that run the network as Lava Processes, in a child process that can be killed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import Advance, Events, Presentations, events_of, front_end_of
from lava_vpr.config import Config
from lava_vpr.configfile import to_dict
from lava_vpr.engine.conductance import model as conductance
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference import counting
from lava_vpr.engine.inference.whole import WholeNetwork, settings_of
from lava_vpr.engine.presentations import PixelBlock, Trains
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.model import Model, checked_network
from lava_vpr.processes.base import lava_checks

SLOWEST = 40.0
"""Lowest accepted speed of Lava, in steps per second; a run ends two minutes after the time that this speed gives."""
_STEPS_OF_DIGIT = 10
"""Steps that take as long as one digit of activity: it needs two, and a reading of all membranes."""


class Timed(NamedTuple):
    """A timed run of Lava.

    Attributes:
        counts: Spikes of each neuron, int32 (n, neurons).
        runs: Presentations, begin and end of each run of Lava, float64 (runs, 3), times in seconds (`time.monotonic`);
            the first run includes compiling and starting.
        held: Memory of Lava's processes together, in bytes; None if the system does not report it.
    """

    counts: NDArray[np.int32]
    runs: NDArray[np.float64]
    held: int | None


@dataclass(frozen=True)
class LavaBackend:
    """The backend that runs the network as Lava Processes.

    Attributes:
        name: Name of the backend.
        job: Function of `lava_vpr.processes.jobs.inference` that wires and runs the network.
        tag: Tag of the ProcessModels: ``fixed_pt`` or ``floating_pt``.
        board: Whether it runs on a Loihi 2 board.
        advance: Called with the number of further presentations that are done.
    """

    name: str
    job: str
    tag: str = "fixed_pt"
    board: bool = False
    advance: Advance | None = None

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], Events]:
        """See `lava_vpr.backends.interface.Backend.count_spikes`."""
        if isinstance(model.network, ConductanceState) and self.tag == "floating_pt":
            return self._conductance(model.network, model.config, shown)
        results = self._run(model, shown, record=False)
        counts = results["counts"].astype(np.int32)
        if "events" in results:
            return counts, dict(zip(counting.EVENTS, (int(x) for x in results["events"]), strict=True))
        network = checked_network(model, self.name)
        return counts, events_of(network, counts, results["input_spikes"], results["inh_spikes"])

    def trains(self, model: Model, shown: Presentations) -> Trains:
        """See `lava_vpr.backends.interface.Backend.trains`; a population that Lava does not record has no train."""
        results = self._run(model, shown, record=True)
        return Trains(**{name: results[name] for name in Trains.POPULATIONS if name in results})

    def timed(self, model: Model, shown: Presentations, *, single: bool) -> Timed:
        """Count spikes, and report when Lava ran; with ``single`` each presentation is a run of its own."""
        results = self._run(model, shown, record=False, timed="single" if single else "runs")
        return Timed(results["counts"].astype(np.int32), results["runs"], int(results["held"][0]) or None)

    def _run(self, model: Model, shown: Presentations, *, record: bool, timed: str = "") -> dict[str, NDArray[Any]]:
        """Run the job on all presentations, and return its arrays."""
        network = checked_network(model, self.name)
        how: dict[str, Any] = {"tag": self.tag, "record": record, "board": self.board, "timed": timed}
        options = network.scalars | how
        rates = shown.rates.astype(np.uint16)
        arrays: dict[str, NDArray[Any]] = {
            "weights": network.weights,
            "bias": network.bias,
            "rates": rates,
            "keys": shown.keys,
        }
        if shown.bias is not None:
            network.check_presented(shown.bias, len(rates))
            arrays["biases"] = shown.bias
        steps = len(rates) * network.interval
        job = f"lava_vpr.processes.jobs.inference:{self.job}"
        return run_isolated(job, arrays, options, timeout=120 + steps / SLOWEST, progress=self.advance)

    def _conductance(
        self, network: ConductanceState, config: Config, shown: Presentations
    ) -> tuple[NDArray[np.int32], Events]:
        """Run the network of preset ``paper`` as float Processes, and return spike counts and events."""
        arrays: dict[str, NDArray[Any]] = {
            "weights": network.weights,
            "theta_mv": network.theta_mv,
            "delays": network.delays,
            "rates": shown.rates,
            "keys": shown.keys,
        }
        constants = conductance.constants(config, learn=False)
        results = run_isolated(
            "lava_vpr.processes.jobs.conductance:conductance",
            arrays,
            {"config": to_dict(config)},
            timeout=120 + len(shown.rates) * constants.total / SLOWEST,
            progress=self.advance,
        )
        events = conductance.named_events(results["events"], len(network.theta_mv), len(shown.rates), constants)
        return results["counts"].astype(np.int32), events


def front_end_trains(
    job: str, tag: str, model: Model, blocks: Iterable[PixelBlock], advance: Advance | None = None
) -> Iterator[dict[str, NDArray[np.uint8]]]:
    """Run the spiking front end as Lava Processes; see `lava_vpr.backends.interface.RunFrontEnd`.

    Args:
        job: Function of `lava_vpr.processes.jobs.front_end`.
        tag: Tag of the ProcessModels.
        model: The model that has the front end.
        blocks: Blocks of images, a run for each.
        advance: Called with the number of further images that are done.
    Yields:
        The spikes of each population by name, uint8 (n, steps, neurons), for each block.
    """
    spec, target = front_end_of(model), f"lava_vpr.processes.jobs.front_end:{job}"
    arrays: dict[str, NDArray[Any]] = {}
    options: dict[str, Any] = {"spec": settings_of(spec), "tag": tag}
    if isinstance(spec, WholeNetwork):
        arrays, options["network"] = {"weights": spec.places.weights, "bias": spec.places.bias}, spec.places.scalars
    for block in blocks:
        given: dict[str, NDArray[Any]] = {"grey": block.grey}
        if block.bias is not None:
            given["biases"] = block.bias
        timeout = 120 + len(block.grey) * spec.steps / SLOWEST
        yield run_isolated(target, arrays | given, options, timeout=timeout, progress=advance)


def gained(
    job: str,
    tag: str,
    digits: NDArray[np.uint16],
    gains: NDArray[np.uint8],
    epoch: NDArray[np.int32],
    advance: Advance | None = None,
) -> NDArray[np.int64]:
    """Multiply activity by gains as Lava Processes; see `lava_vpr.backends.interface.RunGains`.

    Args:
        job: Function of `lava_vpr.processes.jobs.gains`.
        tag: Tag of the ProcessModels.
        digits, gains, epoch, advance: As in `RunGains`.
    """
    arrays: dict[str, NDArray[Any]] = {"digits": digits, "gains": gains, "epoch": epoch}
    timeout = 120 * len(gains) + _STEPS_OF_DIGIT * digits.shape[0] * digits.shape[1] / SLOWEST
    target = f"lava_vpr.processes.jobs.gains:{job}"
    return np.asarray(run_isolated(target, arrays, {"tag": tag}, timeout=timeout, progress=advance)["gained"])


def lava_missing() -> str | None:
    """The reason why Lava cannot run here, with the remedy; None if it can."""
    try:
        lava_checks.require_lava()
    except BackendUnavailableError as error:
        return str(error)
    return None


def loihi2_missing() -> str | None:
    """The reason why no Loihi 2 board can be used here, with the remedy; None if one can."""
    missing = lava_missing()
    if missing is not None:
        return missing
    reason = lava_checks.loihi_available()
    return f"{reason}; --backend lava-library simulates the same network" if reason else None
