"""Holds random networks in Lava against the host engine, and says which differ, and how.

``python tests/support/fuzz/fuzz_compare.py general SEED GROUP BLOCK`` takes one, or ``places SEED START NETWORK``.

Used by engine.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from support.fuzz.fuzz_networks import BLOCKS_OF_GROUP, GROUPS_OF_START, block_of, events_of, steps_of
from support.fuzz.fuzz_places import NETWORKS_OF_START, fused_of, input_of, place_of
from support.literal.integers import as_populations

from lava_vpr.engine.general.simulation import simulate
from lava_vpr.engine.inference.fixed import FixedNetwork, count_spikes
from lava_vpr.errors import NetworkLimitError
from lava_vpr.isolated.runner import run_isolated


@dataclass
class Comparison:
    """Of some networks: how many had which events, and a line for each difference."""

    networks: int = 0
    events: Counter[str] = field(default_factory=Counter)
    differences: list[str] = field(default_factory=list)

    def add(self, happened: dict[str, bool]) -> None:
        """One network more."""
        self.networks += 1
        self.events.update(name for name, did in happened.items() if did)

    def expect(self, name: str, kind: str, what: str, found: NDArray[Any], expected: NDArray[Any]) -> None:
        """Add a line if ``found`` is not ``expected``."""
        if found.shape != expected.shape:
            self.differences.append(f"{name}: {kind}: {what} has shape {found.shape}, not {expected.shape}")
        elif not np.array_equal(found, expected):
            where = tuple(int(k) for k in np.argwhere(found != expected)[0])
            self.differences.append(
                f"{name}: {kind}: {what} differs from the host's in {int((found != expected).sum())} places, first at "
                f"{where}: {int(found[where])}, not {int(expected[where])}; "
                f"alone: python tests/support/fuzz/fuzz_compare.py {name}"
            )

    def __str__(self) -> str:
        counts = ", ".join(f"{n} {name}" for name, n in sorted(self.events.items()))
        return f"{self.networks} networks: {counts}"


def compare_groups(seed: int, chosen: dict[int, Sequence[int]], *, timeout: float) -> Comparison:
    """Run blocks of groups of `fuzz_networks` in Lava, by our Processes and by the library, and on the host."""
    starts: dict[int, list[Any]] = {}
    for group, blocks in chosen.items():
        starts.setdefault(group // GROUPS_OF_START, []).append([group, list(blocks)])
    found = run_isolated(
        "support.fuzz.fuzz_jobs:groups", {}, {"seed": seed, "starts": list(starts.values())}, timeout=timeout
    )
    result = Comparison()
    for group, blocks in chosen.items():
        first, looks = 0, np.array(steps_of(seed, group)) - 1
        for number in blocks:
            block = block_of(seed, group, number)
            done = simulate(block.network, block.train, record=True)
            result.add(events_of(block.network, done))
            part = slice(first, first + block.network.populations[0].size)
            first = part.stop
            states = {"spikes": done.spikes[0], "u": done.film_u[0][looks], "v": done.film_v[0][looks]}
            for kind in ("ours", "library"):
                for what, expected in states.items():
                    result.expect(block.name, kind, what, found[f"{group}_{kind}_{what}"][:, part], expected)
        for kind in ("ours", "library"):
            if found[f"{group}_{kind}_u"].shape[1] != first:
                result.differences.append(f"seed {seed}, group {group}: {kind}: neurons of no network")
    return result


def all_groups(groups: int) -> dict[int, Sequence[int]]:
    """Every block of the first ``groups``."""
    return {group: range(BLOCKS_OF_GROUP) for group in range(groups)}


def _refused(network: FixedNetwork) -> bool:
    try:
        FixedNetwork.check(network)
    except NetworkLimitError:
        return True
    return False


def compare_places(seed: int, chosen: dict[int, Sequence[int]], *, timeout: float) -> Comparison:
    """Run networks of `fuzz_places` in Lava (composed, library, fused) and on the host, by both of its engines.

    Lava presents in a row. Where what is taken wraps it excites, and spikes may still be under way when the silent
    steps are over; then only presentations each by itself equal the engine's.
    """
    starts = [[start, list(numbers)] for start, numbers in chosen.items()]
    found = run_isolated("support.fuzz.fuzz_jobs:places", {}, {"seed": seed, "starts": starts}, timeout=timeout)
    result = Comparison()
    for start, numbers in chosen.items():
        given = input_of(seed, start)
        trains = given.trains
        for number in numbers:
            network, name = place_of(seed, start, number), f"places {seed} {start} {number}"
            spec = as_populations(network)
            _, _, film = count_spikes(network, given.rates, given.keys, raster=True)
            alone = [simulate(spec, train).spikes[0] for train in np.split(trains, len(film))]
            row = simulate(spec, trains, record=True)
            in_a_row, refused = row.spikes[0].reshape(film.shape), _refused(network)
            kept = refused and not np.array_equal(in_a_row, film)
            result.add(events_of(spec, row) | {"refused": refused, "not over after the silent steps": kept})
            result.expect(name, "simulate", "spikes", np.array(alone), film)
            if number == fused_of(start, numbers):
                result.expect(name, "fused", "spikes", found[f"{start}_fused_spikes"], film)
            for kind in ("ours", "library"):
                expected = {"spikes": in_a_row if kept else film, "u": row.u[0], "v": row.v[0]}
                for what, value in expected.items():
                    result.expect(name, kind, what, found[f"{start}_{number}_{kind}_{what}"], value)
    return result


def all_places(starts: int) -> dict[int, Sequence[int]]:
    """Every network of the first ``starts``."""
    return {start: range(NETWORKS_OF_START) for start in range(starts)}


if __name__ == "__main__":
    compare = {"general": compare_groups, "places": compare_places}[sys.argv[1]]
    seed, group, block = (int(word) for word in sys.argv[2:])
    alone = compare(seed, {group: [block]}, timeout=60)
    print("\n".join([str(alone), *alone.differences]))
    sys.exit(bool(alone.differences))
