"""The small network of a rung on one core, in the synapse formats of the bundle."""

from types import SimpleNamespace
from typing import Any, Dict, List, NamedTuple, Optional

import numpy as np

from board_network import COUNTER_UNIT, INDEX_CODES, REGISTER_BITS, WEIGHT_CODES, Network
from chip_program import table_bytes
from refusals import Refused
from rungs import Rung

RELAY, KEEP, FORGET, HIGHEST = COUNTER_UNIT >> 6, 0, 4095, (1 << 17) - 1
EXC, COUNTED, INH = range(3)  # profiles and thresholds
DENSE, DENSE_ROWS = 3, "rows without indices"  # value of the register compression, and the rung's name
TABLES = "tables"


class Forms(NamedTuple):
    """Synapse formats: those of inputs, of the inhibitory neuron and of single synapses."""

    inputs: List[dict]
    root: List[dict]
    single: List[dict]

    @property
    def indexed(self) -> dict:
        """The format of inputs in which rungs store their weights: with indices, also if the bundle has none."""
        first = min(self.inputs, key=lambda form: form["compression"])
        return dict(first, idxBits=max(1, first["idxBits"]), compression=0)


def formats_of(network: Network) -> Forms:
    """The formats that the bundle uses, each once.

    Raises:
        Refused: it has no inputs with weights.
    """
    sources = {tuple(place) for place in network.bundle.array("host/inputs.npy").tolist()}
    root = tuple(network.bundle.array("host/inh.npy")[-1].tolist())
    found = Forms([], [], [])
    ways = [(found.single if sources else found.inputs, way) for way in network.injection[:, 1:].tolist()]
    for core in network.cores:
        for source, *way in core.axons_out.tolist():
            place = (core.chip, core.core, source)
            kind = found.inputs if place in sources else found.root if place == root else found.single
            ways.append((kind, way))
    for kind, way in ways:
        form = _format(network, way)
        if form not in kind:
            kind.append(form)
    if not found.inputs or not found.single:
        raise Refused("bundle", "no input has a weight, so no rung can be built")
    return found


def format_rungs(forms: Forms, bits: int, signed: bool, lateral: int) -> Dict[str, tuple]:
    """A rung, and the format that it is about, for every format of the bundle that no other rung uses, by name."""
    top, found = (1 << bits) - 1, {}  # type: int, Dict[str, tuple]
    for form in forms.inputs:
        if form["compression"] == DENSE:
            found[DENSE_ROWS] = (_dense_rung(top, signed), form)
    for kind, weight, own in (
        (
            "rows of inputs",
            top,
            [form for form in forms.inputs if form["compression"] != DENSE and form != forms.indexed],
        ),
        ("rows of the inhibitory neuron", -lateral, forms.root[1:]),
        ("single synapses", RELAY, forms.single[1:]),
    ):
        for form in own:
            name = "{}, indices of {} bits".format(kind, INDEX_CODES[form["idxBits"]])
            proves = "synapses of such a row go to the compartments that they name, with their weight"
            weights = [[top] * 3, [0, weight, 0]]  # the second row alone has this format: the middle neuron differs
            rung = Rung(name, proves, "such rows are stored otherwise: idxBits", weights, [True] * 2, 4 * top, 0, 0, 1)
            found[name] = (rung, form)
    return found


def _dense_rung(top: int, signed: bool) -> Rung:
    """The rung of rows without indices; in another order its counts would differ."""
    proves = "synapses of a row without indices go to compartments 0, 1, 2 .. in their order, with their sign"
    failure = "such rows are stored otherwise (no public source shows them): deploy without --dense-rows"
    weights = [[top, 0, 1, 1]] + [[0, top, -1, 0]] * signed
    return Rung(DENSE_ROWS, proves, failure, weights, [True] * len(weights), 2 * top, 0, 0, 1)


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
    value = weight << -exponent if exponent < 0 else weight >> exponent
    worth = value << exponent if exponent >= 0 else value >> -exponent
    if worth != weight or value % (1 << REGISTER_BITS - bits) or not -256 <= value <= 255:
        raise Refused("bundle", "a weight of {} does not fit the bundle's synapse format".format(weight))
    return value


def small_network(network: Network, forms: Forms, rung: Rung, own: Optional[dict] = None) -> Any:
    """The rung's network as `Device` and `Simulation` take one: neurons, their counters, the inhibitory neuron.

    A rung about a format has its last row in that one (``own``), or all rows if they have no indices.
    """
    n, inputs = len(rung.weights[0]), len(rung.weights)
    of_inputs, single = forms.indexed, forms.single[0]
    root = forms.root[0] if forms.root else single
    dense = own is not None and own["compression"] == DENSE
    rows, axons, weight = [], [], register_weight
    for i, row in enumerate(rung.weights):
        number = 4 if dense or (own is not None and i == inputs - 1) else 1
        form = own if own is not None and number == 4 else of_inputs
        targets = [j for j in range(n) if row[j] or dense]
        rows.append((number, targets, [weight(row[j], form) for j in targets]))
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
            "synapseFmt": [None, of_inputs, root if rung.lateral else None, single] + [own] * (own is not None),
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
        fingerprint=network.fingerprint,
        inputs=inputs,
        neurons=n,
        steps=network.steps,
        silent=network.silent,
        regular=False,
        bias_input=False,
        adapted=False,
        host_spikes=network.host_spikes,
        ways=network.ways,
        ballast=max(table_bytes(network, chip) for chip in network.chips) if rung.name == TABLES else 0,
        cores=[core],
        of={(0, 0): core},
        chips=[0],
        exc=places,
        counters=places + np.array([0, 0, n], np.int32),
        sources=places[:0],
        injection=np.array([[i, 0, 0, i] for i in range(inputs)], np.int32),
    )


def tables_rung(bits: int) -> Rung:
    """The rung of a program as large as the bundle's."""
    top = (1 << bits) - 1
    proves = "the embedded processors hold tables as large as this bundle's largest"
    failure = "their memory is too small: deploy fewer places, or with --input-mode bias, which has no such tables"
    return Rung(TABLES, proves, failure, [[top]], [True], 3 * top - 1, 0, 0, 1)


def small_queries(network: Any, rung: Rung) -> list:
    """What is sent for the rung's presentations: active inputs spike in every step."""
    spikes = np.tile(np.array(rung.active, bool), (network.steps, 1))
    return [SimpleNamespace(spikes={0: spikes}, settings={}, biases={}) for _ in range(rung.presentations)]
