"""Spike probes: as many as a chip has counters, with the arguments that public programs give."""

from __future__ import annotations

from lava_vpr.deploy.hardware.table import BELIEFS
from nxsdk_standin.cores import Core, CxState
from nxsdk_standin.faults import StandinError

COUNTERS = BELIEFS["spike counters of a chip"]


class Probe:
    """A spike probe."""

    def __init__(self, core: Core, compartment: int) -> None:
        self.core, self.compartment = core, compartment


class Monitor:
    """Makes probes."""

    def __init__(self) -> None:
        self.probes: list[Probe] = []

    def probe(self, state: CxState, places: list[int], key: str, *more: object, **named: object) -> list[Probe]:
        """A probe for each compartment."""
        if more or named:
            raise StandinError(f"monitor.probe takes three arguments ({BELIEFS['monitor.probe'].source})")
        if not isinstance(state, CxState) or key != "spike":
            raise StandinError(f"probe({state}, {places}, {key})")
        made = [Probe(state.core, place) for place in places]
        of_chip = [probe for probe in (*self.probes, *made) if probe.core.parent is state.core.parent]
        said = COUNTERS.refusal(len(of_chip))
        if said:
            raise StandinError(f"All the Spike Counters are being Used: {said}")
        self.probes += made
        return made
