"""NIR: what a graph computes, what comes back of it, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import nir
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from support.common.small_models import small_config, small_model, tiny_paper

from lava_vpr import model as model_file
from lava_vpr.cluster.tasks import ONE_THREAD
from lava_vpr.config import integer_config
from lava_vpr.engine.inference.biases import held_biases
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ConfigError, InputError, LavaVprError, ModelFileError
from lava_vpr.exchange import nir_reading, nir_writing
from lava_vpr.exchange.drawn import digest, whole
from lava_vpr.exchange.formats import FORMATS, FileOptions, format_of, imported
from lava_vpr.model import IntegerModel, Model, integer_model
from lava_vpr.training.measuring import reference_responses

NIR = FORMATS["nir"]


def exported(folder: Path, *, references: bool = True, model: Model | None = None) -> Path:
    """The small model, or another, as a NIR file."""
    path = folder / "net.nir"
    NIR.write(integer_model(model or small_model(), "a test"), path, FileOptions(references=references))
    return path


def altered(path: Path, change: Callable[[nir.NIRGraph], object], *, foreign: bool = False) -> Path:
    """The graph at ``path`` after ``change``; a ``foreign`` one has no metadata, as of another program."""
    graph = nir.read(path)
    if foreign:
        graph.metadata = {}
    change(graph)
    nir.write(path, graph)
    return path


def test_an_unaltered_export_makes_the_same_model_file(tmp_path: Path) -> None:
    for model in (small_model(), replace(small_model(), learned=np.zeros((0, 0), np.float32))):
        made = imported(exported(tmp_path, model=model), NIR)
        assert made.notes == ()
        for path, of in (("a.lvpr", model), ("b.lvpr", made.model)):
            model_file.save(of, tmp_path / path)
        assert (tmp_path / "a.lvpr").read_bytes() == (tmp_path / "b.lvpr").read_bytes()


def test_equal_models_make_equal_files(tmp_path: Path) -> None:
    first = exported(tmp_path).read_bytes()
    assert exported(tmp_path).read_bytes() == first


def test_without_references_a_model_lends_its_own(tmp_path: Path) -> None:
    model, path = small_model(), exported(tmp_path, references=False)
    assert len(path.read_bytes()) < len(exported(tmp_path / "..", references=True).read_bytes()) / 2
    with pytest.raises(InputError, match=r"net.nir: holds a network alone, and .* give --like MODEL"):
        imported(path, NIR)
    assert imported(path, NIR, model).model is not None
    np.testing.assert_array_equal(imported(path, NIR, model).model.responses, model.responses)
    other = small_model(6)
    with pytest.raises(InputError, match="1,568 inputs and 8 neurons, but the model of --like has 1,568 and 6"):
        imported(path, NIR, other)
    with pytest.raises(ConfigError, match="needs an integer network"):
        imported(path, NIR, replace(model, config=tiny_paper()))


def test_an_altered_graph_answers_with_its_own_numbers(tmp_path: Path) -> None:
    """Weights that were trained on elsewhere: rounded in the same unit, responses measured again."""

    def change(graph: nir.NIRGraph) -> None:
        graph.nodes["synapses"].weight[0] *= 0.7

    made = imported(altered(exported(tmp_path), change), NIR)
    before, after = (integer_model(of, "a test").network for of in (small_model(), made.model))
    np.testing.assert_array_equal(after.weights[:, 1:], before.weights[:, 1:])
    np.testing.assert_array_equal(after.weights[:, 0], np.round(before.weights[:, 0] * np.float32(0.7)))
    assert "weights are rounded to 3 bits and a sign: by" in made.notes[0]
    model = made.model
    measured = reference_responses(after, model.activity, model.places, model.config, ONE_THREAD)
    np.testing.assert_array_equal(model.responses, measured)
    assert (made.model.responses != small_model().responses).any()
    assert made.model.calibration is not None
    model_file.save(made.model, tmp_path / "a.lvpr")
    assert digest(integer_model(model_file.load(tmp_path / "a.lvpr"), "a test").network) == digest(after)


def as_cuba(graph: nir.NIRGraph) -> None:
    """The same neurons as CubaLIF, whose current lasts one step."""
    lif = graph.nodes["population.lif"]
    step = np.full(lif.tau.shape, 1e-4)
    graph.nodes["population.lif"] = nir.CubaLIF(
        tau_syn=step, tau_mem=lif.tau, r=lif.r / 4, v_leak=lif.v_leak, v_threshold=lif.v_threshold, w_in=0 * step + 4
    )


def in_volts(graph: nir.NIRGraph) -> None:
    """The same network in other units: everything that adds to a membrane, and the threshold, in the same measure."""
    graph.nodes["synapses"].weight *= 2.0**-20
    graph.nodes["synapses"].bias *= 2.0**-20
    graph.nodes["population.w_rec"].weight *= 2.0**-20
    graph.nodes["population.lif"].v_threshold *= 2.0**-20


def with_gain(graph: nir.NIRGraph) -> None:
    """Half the resistance and twice the current."""
    graph.nodes["population.lif"].r /= 2
    for name in ("synapses", "population.w_rec"):
        graph.nodes[name].weight *= 2
    graph.nodes["synapses"].bias *= 2


@pytest.mark.parametrize("change", [as_cuba, with_gain, lambda graph: None])
def test_a_foreign_graph_of_that_shape_is_the_same_network(
    tmp_path: Path, change: Callable[[nir.NIRGraph], None]
) -> None:
    made = imported(altered(exported(tmp_path), change, foreign=True), NIR, small_model())
    assert made.notes == ()
    assert digest(integer_model(made.model, "").network) == digest(integer_model(small_model(), "").network)


def test_a_foreign_graph_in_other_units_is_rounded_as_training_rounds(tmp_path: Path) -> None:
    """Here the largest weights make the unit; the small model's reach the top of its bits, so nothing is lost."""
    made = imported(altered(exported(tmp_path), in_volts, foreign=True), NIR, small_model())
    assert digest(integer_model(made.model, "").network) == digest(integer_model(small_model(), "").network)


def test_a_graph_without_a_recurrent_edge_has_no_inhibition(tmp_path: Path) -> None:
    def change(graph: nir.NIRGraph) -> None:
        del graph.nodes["population.w_rec"]
        graph.edges = [edge for edge in graph.edges if "population.w_rec" not in edge]
        cut = slice(0, 8)
        lif = graph.nodes["population.lif"]
        graph.nodes["population.lif"] = nir.IF(r=np.full(8, 1e4), v_threshold=lif.v_threshold[cut])
        graph.nodes["synapses"] = nir.Linear(graph.nodes["synapses"].weight[cut])
        graph.nodes["output"] = nir.Output({"output": np.array([8])})

    made = imported(altered(exported(tmp_path), change, foreign=True), NIR, small_model())
    network, before = (integer_model(of, "").network for of in (made.model, small_model()))
    assert (network.lateral, network.decay, int(network.bias.any())) == (0, 0, 0)
    np.testing.assert_array_equal(network.weights, before.weights)


@st.composite
def networks(draw: st.DrawFn) -> FixedNetwork:
    """Any network of few inputs that `FixedNetwork.check` accepts."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    signed, neurons = draw(st.booleans()), draw(st.integers(1, 6))
    bits = draw(st.integers(1, 8 - signed))
    top = (1 << bits) - 1
    weights = rng.integers(-top if signed else 0, top + 1, (5, neurons)).astype(np.int16)
    weights[0, 0] = top
    network = FixedNetwork(
        weights=weights,
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=draw(st.integers(1, 5000)),
        inhibition=draw(st.integers(0, 255)),
        inhibition_exponent=draw(st.integers(0, 3)),
        decay=draw(st.integers(0, 4096)),
        steps=125,
        regular=True,
    )
    most = max(1, min(1 << 14, network.highest_bias))
    return replace(network, bias=held_biases(rng.integers(-(1 << 14), most, neurons)))


@given(networks(), st.sampled_from([1e-4, 1e-3, 1.0, 0.037]))
@settings(max_examples=60, deadline=None)
def test_every_number_comes_back(network: FixedNetwork, time_step: float) -> None:
    """With our metadata: bits, mantissas and all. `whole` takes the rest from the settings."""
    graph = nir_writing.graph_of(network, time_step)
    drawn = nir_reading.network_of(graph, 1.0)
    config = small_config(network={"signed": network.signed, "weight_bits": network.bits})
    made = whole(drawn, integer_config(config, "a test").network)
    assert made.notes == ()
    assert digest(made.network) == digest(network)


def test_more_neurons_than_one_can_listen_to_have_leaves() -> None:
    neurons = 4500
    weights = np.random.default_rng(0).integers(-7, 8, (2, neurons)).astype(np.int16)
    bias = np.zeros(neurons, np.int32)
    network = FixedNetwork(weights, bias, 3, True, 9, 5, 0, 341, 123, True)
    assert network.leaves == 2
    matrix = nir_writing.recurrence(network)
    assert matrix.shape == (4503, 4503)
    fired = matrix[:, 4097] > 2 * 8 * 64
    assert list(np.flatnonzero(fired)) == [4501]
    drawn = nir_reading.network_of(nir_writing.graph_of(network, 1e-4), 1e-4)
    np.testing.assert_array_equal(drawn.weights, network.weights * 64.0)
    assert drawn.inhibition == 5 * 64


def set_to(name: str, key: str, value: object) -> Callable[[nir.NIRGraph], None]:
    return lambda graph: setattr(graph.nodes[name], key, value)


def first(name: str, key: str, value: float) -> Callable[[nir.NIRGraph], None]:
    """Another value of the first neuron, input or whatever it is."""
    return lambda graph: getattr(graph.nodes[name], key).ravel().__setitem__(0, value)


def everywhere(name: str, key: str, value: float) -> Callable[[nir.NIRGraph], None]:
    return lambda graph: getattr(graph.nodes[name], key).fill(value)


def scaled(name: str) -> Callable[[nir.NIRGraph], None]:
    return lambda graph: graph.nodes.__setitem__(name, nir.Scale(np.ones(9)))


REFUSED = [
    (first("synapses", "weight", np.nan), "has NaN or infinity in 'weight' of node 'synapses'"),
    (first("population.lif", "tau", np.inf), "has NaN or infinity in 'tau' of node 'population.lif'"),
    (first("population.lif", "tau", 2.0), "has neurons that differ in tau"),
    (first("population.lif", "v_threshold", 2.0), "has neurons that differ in v_threshold"),
    (everywhere("population.lif", "v_reset", 2.0), "resets membranes to other than 0"),
    (everywhere("population.lif", "tau", 1e-7), "has a time constant of 1e-07 s, less than a step of 0.0001 s"),
    (everywhere("population.lif", "tau", -1.0), "has a time constant of -1 s, less than a step"),
    (everywhere("synapses", "weight", 0.0), "all weights of the network are 0"),
    (everywhere("population.lif", "v_threshold", -5.0), "has a recurrent edge other|the threshold is"),
    (everywhere("population.lif", "v_threshold", 1e30), "has a recurrent edge other than one inhibitory neuron"),
    (first("population.w_rec", "weight", 3.0), "has a recurrent edge other than one inhibitory neuron"),
    (everywhere("population.w_rec", "weight", 3.0), "has a last neuron that does not take the same"),
    (everywhere("synapses", "bias", 3.0), "has inputs or biases of its inhibitory neurons"),
    (everywhere("synapses", "bias", 1e12), "has inputs or biases of its inhibitory neurons"),
    (first("synapses", "bias", 500_000.0), "makes its neuron spike without input"),
    (first("synapses", "bias", -1e30), r"a bias is -1.5625e\+28 times a weight of 1, but must be at most 8190"),
    (lambda graph: graph.nodes["population.w_rec"].weight.__setitem__((slice(8), -1), -1e30), "the inhibition is"),
    (scaled("output"), "has 'Scale', node 'output'"),
    (lambda graph: graph.edges.append(("population.w_rec", "output")), "has the edges"),
    (lambda graph: graph.edges.remove(("input", "synapses")), "is not accepted by NIR's own package|has the "),
    (lambda graph: graph.edges.append(("nowhere", "output")), "is not accepted by NIR's own package"),
    (lambda graph: graph.nodes.__setitem__("more", nir.Input({"input": np.array([1568])})), "has the nodes"),
    (set_to("synapses", "weight", np.zeros((9, 3), np.float32)), "is not accepted by NIR's own package"),
    (lambda graph: graph.metadata.__setitem__("time_step", -1.0), "has a time_step of -1.0"),
    (lambda graph: graph.metadata.__setitem__("network", "{"), "has metadata 'network' '{'"),
    (lambda graph: graph.metadata.__setitem__("network", "[1]"), r"has metadata 'network' '\[1\]'"),
    (lambda graph: graph.metadata.__setitem__("weight_unit", "x"), "has metadata 'weight_unit' 'x'"),
    (lambda graph: graph.metadata.__setitem__("references", 3), "has references that are no bytes: 3"),
]


@pytest.mark.parametrize(("change", "said"), REFUSED)
def test_every_other_graph_is_refused_in_one_line(
    tmp_path: Path, change: Callable[[nir.NIRGraph], None], said: str
) -> None:
    path = altered(exported(tmp_path), change)
    with pytest.raises(InputError, match=said) as caught:
        imported(path, NIR)
    assert str(caught.value).startswith(f"{path}: the ")
    assert "\n" not in str(caught.value)


def test_references_that_are_no_models_are_refused(tmp_path: Path) -> None:
    def change(graph: nir.NIRGraph) -> None:
        graph.metadata["references"] = graph.metadata["references"][:-9]

    with pytest.raises(ModelFileError, match=r"net.nir: the references is damaged"):
        imported(altered(exported(tmp_path), change), NIR)

    def of(model: Model) -> Callable[[nir.NIRGraph], None]:
        packed = np.frombuffer(nir_writing.container_of(integer_model(model, "a test")), np.uint8)
        return lambda graph: graph.metadata.__setitem__("references", packed)

    with pytest.raises(ModelFileError, match=r"net.nir: the float weights in it are no array \(1568, 8\)"):
        imported(altered(exported(tmp_path), of(small_model(6))), NIR)
    bare = replace(small_model(6), learned=np.zeros((0, 0), np.float32))
    with pytest.raises(ModelFileError, match=r"net.nir: the model has no valid references of 6 neurons"):
        imported(altered(exported(tmp_path), of(bare)), NIR)


def test_a_graph_too_large_to_be_read_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LAVA_VPR_MAX_MODEL_BYTES", "50000")
    with pytest.raises(InputError, match=r"net.nir: the NIR graph would unpack to 56,772 bytes, more than the 50,000"):
        exported(tmp_path)
    assert not (tmp_path / "net.nir").exists()


def test_formats_are_chosen_by_ending_or_by_name(tmp_path: Path) -> None:
    assert format_of(Path("A.NIR")) is NIR
    assert format_of(Path("a.h5x"), "nir") is NIR
    with pytest.raises(InputError, match=r"a\.txt: no format has names that end so; name it \.nir"):
        format_of(Path("a.txt"))
    with pytest.raises(LavaVprError, match="there is no format 'x'; choose from nir"):
        format_of(Path("a.txt"), "x")


def test_what_is_written_needs_a_place(tmp_path: Path) -> None:
    model: IntegerModel = integer_model(small_model(), "a test")
    with pytest.raises(InputError, match=r"net.nir: the NIR graph cannot be written \(No such file"):
        NIR.write(model, tmp_path / "missing" / "net.nir", FileOptions())
