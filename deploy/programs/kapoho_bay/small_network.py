"""The small network of a rung on one core, in the synapse formats of the bundle."""

from types import SimpleNamespace
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from board_network import COUNTER_UNIT, INDEX_CODES, REGISTER_BITS, WEIGHT_CODES, Network
from chip_program import table_bytes
from layer_rungs import LayerRung
from refusals import Refused
from rungs import SHIFT, Rung

RELAY, KEEP, FORGET, HIGHEST = COUNTER_UNIT >> 6, 0, 4095, (1 << 17) - 1
EXC, COUNTED, INH = range(3)  # profiles and thresholds
DENSE, DENSE_ROWS = 3, "rows without indices"  # value of the register compression, and the rung's name
TABLES = "tables"
LARGEST = 127  # weight of a synapse whose sign takes one of 8 bits


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
    neurons = [(FORGET, decay, level) for decay, level in ((rung.decay, rung.threshold), (KEEP, HIGHEST), (FORGET, 1))]
    formats = [None, of_inputs, root if rung.lateral else None, single] + [own] * (own is not None)
    ballast = max(table_bytes(network, chip) for chip in network.chips) if rung.name == TABLES else 0
    return _on_one_core(network, [EXC] * n + [COUNTED] * n + [INH], neurons, formats, rows, axons, inputs, n, ballast)


class SmallNetworks:
    """Builds the networks of rungs in the synapse formats of a bundle.

    `layers` are the formats of each layer of its front end; `own`, by name, the rungs about a format, each with that
    format. A bundle whose neurons hear the front end has no formats but the layers'.
    """

    def __init__(self, network: Network) -> None:
        self.network, self.layers = network, layer_forms(network)
        self.forms, self.own = Forms([], [], []), {}  # type: Forms, Dict[str, tuple]
        if not network.direct:
            bits, signed, size, exponent = network.bundle.numbers("bits", "signed", "inhibition", "inhibition_exponent")
            self.forms = formats_of(network)
            self.own = format_rungs(self.forms, bits, bool(signed), size << exponent)

    def of_inputs(self, rung: Rung) -> Tuple[Any, list]:
        """The network of a rung whose inputs are injected, and what is sent to it."""
        small = small_network(self.network, self.forms, rung, self.own.get(rung.name, (rung, None))[1])
        return small, small_queries(small, rung)

    def of_biases(self, rung: LayerRung) -> Tuple[Any, list]:
        """The network of a rung of a layer, which biases drive, and what is sent to it."""
        single = self.layers["counters"][0] if self.network.direct else self.forms.single[0]
        small = layer_network(self.network, single, self.layers[rung.layer], rung)
        return small, layer_queries(small, rung)


def layer_forms(network: Network) -> Dict[str, List[dict]]:
    """The synapse formats of each layer's first core, by the layer; none if the bundle holds no front end."""
    folder, found = "front_end/", {}
    for name in sorted(network.bundle.files):
        if name.startswith(folder + "host/"):
            chip, core = network.bundle.array(name)[0, :2].tolist()
            registers = network.bundle.json("{}cores/chip{}-core{:03d}/registers.json".format(folder, chip, core))
            forms = sorted((form for form in registers["synapseFmt"] if form), key=lambda form: form["wgtExp"])
            found[name.split("/")[-1].split(".")[0]] = forms
    return found


def layer_network(network: Network, single: dict, of_layer: List[dict], rung: LayerRung) -> Any:
    """The rung's network as `Device` and `Simulation` take one: neurons and their counters; nothing is injected.

    Counters have synapses of the format ``single``. Weights of one synapse have the format ``of_layer`` with the least
    exponent, larger ones that with the greatest.
    """
    n, rows, axons = len(rung.neurons), [(1, [0], [register_weight(1, of_layer[0])])], []
    for source in range(n):
        ways = [(target, weight) for start, target, weight in rung.synapses if start == source]
        for number, form, own in (
            (1, of_layer[0], [way for way in ways if abs(way[1]) <= LARGEST]),
            (2, of_layer[-1], [way for way in ways if abs(way[1]) > LARGEST]),
        ):
            if own:
                axons.append((source, len(rows)))
                rows.append((number, [way[0] for way in own], [register_weight(way[1], form) for way in own]))
        axons.append((source, len(rows)))
        rows.append((3, [n + source], [register_weight(RELAY, single)]))
    kinds = sorted(set(rung.neurons))
    numbers = [kinds.index(neuron) for neuron in rung.neurons] + [len(kinds)] * n
    formats = [None, of_layer[0], of_layer[-1], single]
    made = _on_one_core(network, numbers, [*kinds, (FORGET, KEEP, HIGHEST)], formats, rows, axons, 1, n)
    made.adapted = True
    return made


def _on_one_core(
    network: Network,
    kinds: List[int],
    neurons: List[tuple],
    formats: List[Optional[dict]],
    rows: List[tuple],
    axons: List[tuple],
    inputs: int,
    n: int,
    ballast: int = 0,
) -> Any:
    """A network on one core; input i is injected at axon i, and the ``n`` compartments that come first are counted by
    those that follow them.

    ``neurons`` has decays of u and v and threshold of each kind, ``kinds`` that of each compartment, ``rows`` format,
    compartments and register weights of each axon, ``axons`` pairs of compartment and axon.
    """
    profile = {"refractDelay": 1, "enableNoise": 0, "bapAction": 1}
    sizes = [len(row[1]) for row in rows]
    core = SimpleNamespace(
        name="rung",
        chip=0,
        core=0,
        registers={
            "cxProfileCfg": [dict(profile, decayU=decay_u, decayV=decay_v) for decay_u, decay_v, _ in neurons],
            "vthProfileCfg": [{"vth": level} for *_, level in neurons],
            "synapseFmt": formats,
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
        direct=False,
        adapted=False,
        host_spikes=network.host_spikes,
        ways=network.ways,
        ballast=ballast,
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


def layer_queries(network: Any, rung: LayerRung) -> list:
    """What is sent for the rung's presentations: biases, in units of 2^6."""
    spikes = {0: np.zeros((network.steps, 1), bool)}
    return [SimpleNamespace(spikes=spikes, settings={}, biases={0: np.array(row) * 8 + SHIFT}) for row in rung.biases]
