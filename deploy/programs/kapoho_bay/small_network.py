"""The small network of a rung on one core, in the synapse formats of the bundle."""

from types import SimpleNamespace
from typing import Any, List

import numpy as np

from board_network import COUNTER_UNIT, INHIBITORY, MIXED, WEIGHT_BITS, WEIGHT_CODES, Network
from refusals import Refused
from rungs import Rung

RELAY, KEEP, FORGET, HIGHEST = COUNTER_UNIT >> 6, 0, 4095, (1 << 17) - 1
EXC, COUNTED, INH = range(3)  # profiles and thresholds
DENSE = "rows without indices"


def dense_rungs(network: Network) -> List[Rung]:
    """The rung of rows without indices, if the bundle stores inputs so."""
    formats = [form for core in network.cores for form in core.registers["synapseFmt"] if form]
    weights = formats_of(network)[0]
    if dict(weights, idxBits=0, compression=3) not in formats:
        return []
    proves = "synapses of a row without indices go to compartments 0, 1, 2 .. in their order"
    failure = "such rows are stored otherwise (no public source shows them): deploy with sparse rows"
    return [Rung(DENSE, proves, failure, [[1, 1, 1], [1, 1, 1]], [True, False], 2, 0, 0, 1)]


def formats_of(network: Network) -> tuple:
    """The formats of the bundle's inputs, of its root, and of single synapses.

    Raises:
        Refused: it has no inputs with weights.
    """
    root_chip, root_core, root = network.bundle.array("host/inh.npy")[-1].tolist()
    ways = [w[1:] for w in network.of[root_chip, root_core].axons_out.tolist() if w[0] == root]
    chip, core, neuron = network.exc[0].tolist()
    counter = network.counters[0].tolist()
    single = [w[1:] for w in network.of[chip, core].axons_out.tolist() if w[0] == neuron and w[1:3] == counter[:2]]
    into = network.injection[:, 1:].tolist()
    for chip, core, i in network.bundle.array("host/inputs.npy").tolist():
        into += [w[1:] for w in network.of[chip, core].axons_out.tolist() if w[0] == i]
    inputs = [_format(network, way) for way in into]
    exc = {tuple(place) for place in network.exc[:, :2].tolist()}
    weights = [inputs[i] for i, way in enumerate(into) if tuple(way[:2]) in exc]
    sparse = [form for form in weights if form["idxBits"]] or weights
    singles = [form for form in (_format(network, way) for way in single) if form["idxBits"]]
    if not sparse or not singles:
        raise Refused("bundle", "no input has a weight, so no rung can be built")
    return sparse[0], _format(network, ways[0]) if ways else singles[-1], singles[-1]


def _format(network: Network, way: list) -> dict:
    """The format of the row at an input axon (chip, core, axon)."""
    core = network.of[way[0], way[1]]
    return dict(core.registers["synapseFmt"][core.rows[core.row_of_axon.reshape(-1)[way[2]]][0]])


def register_weight(weight: int, form: dict) -> int:
    """The register that holds a weight in a format.

    Raises:
        Refused: it does not fit.
    """
    bits, exponent = WEIGHT_CODES[form["wgtBits"]], form["wgtExp"]
    mixed, unit = form["fanoutType"] == MIXED, 1 << WEIGHT_BITS + (form["fanoutType"] == MIXED) - bits
    value = weight << -exponent if exponent < 0 else weight >> exponent
    worth = value << exponent if exponent >= 0 else value >> -exponent
    one_sign = -1 if form["fanoutType"] == INHIBITORY else 1
    if worth != weight or value % unit or not -256 <= value <= 255 or not (mixed or value * one_sign >= 0):
        raise Refused("bundle", "a weight of {} does not fit the bundle's synapse format".format(weight))
    return value


def small_network(network: Network, rung: Rung) -> Any:
    """The rung's network as `Device` and `Simulation` take one: neurons, their counters, the inhibitory neuron."""
    n, inputs = len(rung.weights[0]), len(rung.weights)
    of_inputs, of_root, single = formats_of(network)
    dense = dict(of_inputs, idxBits=0, compression=3)
    of_inputs = dense if rung.name == DENSE else dict(of_inputs, idxBits=max(1, of_inputs["idxBits"]), compression=0)
    root = of_root  # dense or not: it has a weight for every neuron
    rows, axons, weight = [], [], register_weight
    for row in rung.weights:
        targets = [i for i in range(n) if row[i]]
        rows.append((1, targets, [weight(row[i], of_inputs) for i in targets]))
    if rung.lateral:
        axons.append((2 * n, len(rows)))
        rows.append((2, list(range(n)), [weight(-rung.lateral, root)] * n))
    for i in range(n):
        axons += [(i, len(rows)), (i, len(rows) + 1)]
        rows += [(3, [n + i], [weight(RELAY, single)]), (3, [2 * n], [weight(RELAY, single)])]
    decays, levels = (rung.decay, KEEP, FORGET), (rung.threshold, HIGHEST, 1)
    profile = {"decayU": FORGET, "refractDelay": 1, "enableNoise": 0, "bapAction": 1}
    kinds = [EXC] * n + [COUNTED] * n + [INH]
    sizes = [len(row[1]) for row in rows]
    core = SimpleNamespace(
        name="rung",
        chip=0,
        core=0,
        registers={
            "cxProfileCfg": [dict(profile, decayV=decay) for decay in decays],
            "vthProfileCfg": [{"vth": level} for level in levels],
            "synapseFmt": [None, of_inputs, root, single] if rung.lateral else [None, of_inputs, None, single],
            "dendriteSharedCfg": network.cores[0].registers["dendriteSharedCfg"],
            "numUpdates": {"numUpdates": -(-len(kinds) // 4), "numStdp": 0},
        },
        compartments=np.array([[kind, kind, 0, 0] for kind in kinds], np.int32),
        axons_out=np.array([[source, 0, 0, row] for source, row in sorted(axons)], np.int32),
        rows=rows,
        row_of_axon=np.arange(len(rows)),
        pointers=[sum(sizes[:r]) for r in range(len(sizes))],
        synapses=sum(sizes),
    )
    places = np.zeros((n, 3), np.int32)
    places[:, 2] = np.arange(n)
    return SimpleNamespace(
        bundle=network.bundle,
        inputs=inputs,
        neurons=n,
        steps=network.steps,
        silent=network.silent,
        regular=False,
        bias_input=False,
        adapted=False,
        host_spikes=network.host_spikes,
        cores=[core],
        of={(0, 0): core},
        chips=[0],
        exc=places,
        counters=places + np.array([0, 0, n], np.int32),
        sources=places[:0],
        injection=np.array([[i, 0, 0, i] for i in range(inputs)], np.int32),
    )


def small_queries(network: Any, rung: Rung) -> list:
    """What is sent for the rung's presentations: active inputs spike in every step."""
    spikes = np.tile(np.array(rung.active, bool), (network.steps, 1))
    return [SimpleNamespace(spikes={0: spikes}, settings={}, biases={}) for _ in range(rung.presentations)]
