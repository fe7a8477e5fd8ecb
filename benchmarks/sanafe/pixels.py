"""Spikes of a whole network from pixels to places in SANA-FE: messages and synaptic operations, by its own count.

SANA-FE's somata have no currents that last, so they play the spikes of all populations, and what they take is not
compared: neurons times steps. Every core of the plan is one core of SANA-FE that plays; another one for each of its
formats of rows receives, since SANA-FE sends one message to a core where Loihi sends one for each axon. All stand on
one tile: the cost model leaves hops out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from benchmarks.sanafe.cross_check import apart, ask
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.cost.front_end import front_end_costs
from lava_vpr.deploy.mapping.front_end import PlacedFrontEnd, placed
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.errors import InputError
from lava_vpr.inputs.front_end import FrontEnd

Pair = tuple[NDArray[np.float64], NDArray[np.float64]]
MUTE = {"threshold": float(1 << 20), "leak_decay": 0.0}
"""Somata that receive, and never spike."""


@dataclass(frozen=True)
class PixelsChecked:
    """SANA-FE beside the cost model, for each image.

    Attributes:
        version: The version of SANA-FE.
        counts: Events by name: (ours, SANA-FE's), float64 (n,) each.
        microjoules: Energy of both, likewise.
    """

    version: str
    counts: dict[str, Pair]
    microjoules: dict[str, Pair]

    @property
    def difference(self) -> float:
        """The largest relative difference of any image."""
        return max(apart(*pair) for pair in (*self.counts.values(), *self.microjoules.values()))


def _groups(plan: PlacedFrontEnd) -> list[dict[str, Any]]:
    """A group that plays for each core of the plan, and one that receives for each core and exponent of rows to it."""
    names = [(f"{name}.{core}", size, True) for name, core, size in _cores(plan)]
    received = {(target, exponent) for _, target, exponent in plan.rows}
    names += [
        (_receiver(name, core, exponent), size, False)
        for name, core, size in _cores(plan)
        for exponent in sorted(exponent for target, exponent in received if target == name)
    ]
    return [
        {
            **{"name": name, "size": size, "plays": plays, "attributes": {} if plays else MUTE},
            **{"tile": 0, "core": number, "own_biases": []},
        }
        for number, (name, size, plays) in enumerate(names)
    ]


def _cores(plan: PlacedFrontEnd) -> Iterator[tuple[str, int, int]]:
    """Population, number among its cores, and neurons of each core."""
    for name, each in plan.populations.items():
        for core, size in enumerate(each.sizes.tolist()):
            yield name, core, size


def _receiver(name: str, core: int, exponent: int) -> str:
    return f"{name}.{core} of {exponent}"


def _synapses(plan: PlacedFrontEnd) -> Iterator[dict[str, Any]]:
    """Synapses between each two cores."""
    for (source, target, exponent), weights in plan.rows.items():
        to, of, found = plan.populations[target], plan.populations[source], coo_matrix(weights)
        at, sender = (
            np.searchsorted(each.starts, index, side="right") - 1 for each, index in ((to, found.row), (of, found.col))
        )
        for core, other in np.unique(np.stack([at, sender]), axis=1).T.tolist():
            chosen = (at == core) & (sender == other)
            pre, post = found.col[chosen] - of.starts[other], found.row[chosen] - to.starts[core]
            ends = {"from": f"{source}.{other}", "to": _receiver(target, core, exponent), "kind": "sparse"}
            yield ends | {"pre": pre.tolist(), "post": post.tolist(), "weights": found.data[chosen].tolist()}


def problem_of_pixels(spec: FrontEnd, plan: PlacedFrontEnd, images: PixelBlock) -> dict[str, Any]:
    """The JSON of `benchmarks.sanafe.problem` for images that a front end is shown, with what hears its cells."""
    groups, films = _groups(plan), spec.trains(*images)
    return {
        **{"columns": 1, "rows": 1, "tiles": 1, "tile_cores": len(groups), "port_units": 0, "port_takes_time": True},
        "core_units": max(one["size"] for one in groups if one["plays"]),
        "steps": spec.steps - 1,
        "silent_steps": 1,
        "groups": groups,
        "synapses": list(_synapses(plan)),
        "queries": [_query(plan, {name: film[k] for name, film in films.items()}) for k in range(len(images.grey))],
    }


def _query(plan: PlacedFrontEnd, films: dict[str, NDArray[np.uint8]]) -> dict[str, Any]:
    """The trains of all neurons that spike, of ``films`` (steps, neurons)."""
    trains = []
    for name, each in plan.populations.items():
        for neuron in np.flatnonzero(films[name].any(axis=0)).tolist():
            core = int(np.searchsorted(each.starts, neuron, side="right")) - 1
            spikes = films[name][:, neuron]
            last = int(np.flatnonzero(spikes)[-1])
            trains.append([f"{name}.{core}", neuron - int(each.starts[core]), spikes[: last + 1].astype(int).tolist()])
    return {"trains": trains, "biases": [], "own_biases": []}


def check_pixels(spec: FrontEnd, images: PixelBlock) -> PixelsChecked:
    """SANA-FE and the cost model on a whole network and some images, which it sees as Kapoho Bay would.

    Raises:
        InputError: SANA-FE's environment is missing, or it fails.
    """
    plan, constants = placed(spec, KAPOHO_BAY), KAPOHO_BAY.constants
    if constants is None:
        raise InputError(f"{KAPOHO_BAY.title} has no public constants, so there is nothing to compare")
    answer = ask(problem_of_pixels(spec, plan, images))
    every = [front_end_costs(spec, plan, one).all for one in images.in_parts(1)]
    operations, messages, spikes = (
        np.array([getattr(one, name) for one in every], np.float64) for name in ("operations", "messages", "spikes")
    )

    def theirs(key: str, scale: float = 1.0) -> NDArray[np.float64]:
        return np.array([scale * np.sum(query[key]) for query in answer["queries"]], np.float64)

    return PixelsChecked(
        str(answer["version"]),
        {
            "synaptic operations": (operations, theirs("spikes")),
            "messages": (messages, theirs("packets")),
            "spikes": (spikes, theirs("fired")),
        },
        {
            "synapse": (operations * constants.synapse_sparse.nominal / 1e6, theirs("synapse_energy", 1e6)),
            "network": (messages * constants.message.nominal / 1e6, theirs("network_energy", 1e6)),
        },
    )
