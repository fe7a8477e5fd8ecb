"""NetX files: what lava-dl loads spikes as the network that they hold; import reads them, and refuses what is none."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from support.common.small_models import encoded, small_config

from benchmarks import places
from lava_vpr import model as model_file
from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.cli import main
from lava_vpr.config import preset
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import InputError, NetworkLimitError
from lava_vpr.exchange import netx
from lava_vpr.exchange.formats import FORMATS, TIME_STEP, FileOptions
from lava_vpr.model import IntegerModel, decode, integer_model
from lava_vpr.slayer import needs
from lava_vpr.training.loop import train

with_lava_dl = pytest.mark.skipif(needs.missing() is not None, reason=f"lava-dl is left out: {needs.missing()}")


NETX = FORMATS["netx"]


def small() -> IntegerModel:
    return integer_model(train([encoded()], small_config()), "a test")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "m.net"
    NETX.write(small(), path, FileOptions())
    return path


def loaded_spikes(path: Path, network: FixedNetwork, trains: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Spikes of all neurons of the file as lava-dl loads and Lava simulates it, (n, interval, neurons + 1)."""
    from lava.lib.dl.netx.hdf5 import Network
    from lava.magma.core.run_conditions import RunSteps
    from lava.magma.core.run_configs import Loihi2SimCfg
    from lava.proc.io.sink import RingBuffer as Sink
    from lava.proc.io.source import RingBuffer as Source

    steps = len(trains) * network.interval
    whole = Network(str(path), reset_interval=network.interval, input_shape=(network.inputs,))
    source = Source(data=trains.reshape(steps, -1).T.astype(np.int32))
    sink = Sink(shape=whole.out.shape, buffer=steps)
    source.s_out.connect(whole.inp)
    whole.out.connect(sink.a_in)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # networkx's, when it is first used
        try:
            whole.run(RunSteps(steps), Loihi2SimCfg(select_tag="fixed_pt"))
            found = sink.data.get()
        finally:
            whole.stop()
    return np.asarray(found.T.reshape(len(trains), network.interval, -1), np.int64)


def compared(model: IntegerModel, queries: EncodedTraverse, path: Path) -> tuple[NDArray[Any], ...]:
    """Counts of the loaded file, of the network that it holds, and of the model's own; each spike is compared."""
    NETX.write(model, path, FileOptions(references=False))
    network = netx.held(model.network)
    shown = query_presentations(model, queries)
    trains = draw_trains(shown.rates, shown.keys, network.steps, network.interval, regular=network.regular)
    own = HostBackend().trains(replace(model, network=network), shown)
    found = loaded_spikes(path, network, trains)
    assert np.array_equal(found[:, :, :-1], own.exc)
    assert np.array_equal(found[:, :, -1:], own.inh)
    return found[:, :, :-1].sum(axis=1), own.exc.sum(axis=1), HostBackend().trains(model, shown).exc.sum(axis=1)


@with_lava_dl
def test_lava_dl_spikes_as_the_network_that_the_file_holds(tmp_path: Path) -> None:
    loaded, held, own = compared(small(), encoded(noise=0.5), tmp_path / "m.net")
    assert np.array_equal(loaded, held)
    assert loaded.sum() > 8
    assert np.array_equal(held.argmax(axis=1), own.argmax(axis=1))


@with_lava_dl
@pytest.mark.slow
@pytest.mark.data
def test_a_hundred_real_queries(tmp_path: Path, data_root: Path) -> None:
    """Nordland 200:300: every spike, of all neurons; and how far rounded biases lead from the model's own counts."""
    config = preset("loihi")
    queries = places.encoded("winter", config.encoder).take(slice(200, 300))
    model = integer_model(places.learn((200, 300), config), "a test")
    loaded, held, own = compared(model, queries, tmp_path / "m.net")
    assert loaded.shape == (100, 100)
    assert np.array_equal(loaded, held)
    print(f"{held.sum()} spikes; counts that rounded biases change: {100 * np.mean(held != own):.2f} %")
    assert np.mean(held != own) < 0.05
    answers = [decode(model, counts, "contrast").argmax(axis=1) for counts in (held, own)]
    assert np.array_equal(*answers)


def test_what_is_held_is_the_network_with_coarser_biases() -> None:
    network = small().network
    made = netx.held(network)
    factor = made.threshold // network.threshold
    assert factor in (1, 2, 4, 8, 16)
    assert np.array_equal(made.weights, network.weights * factor)
    assert made.lateral == network.lateral * factor
    assert not (made.bias % 64).any()
    assert np.abs(made.bias - network.bias * factor).max() <= 32
    assert 2 * max(made.threshold, made.lateral) >= 127 or made.bits == 7
    assert netx.held(replace(network, threshold=100)).bits == network.bits


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"threshold": 127}, r"threshold 127 and inhibition \d+ are synapses in NetX, which must stay below 127"),
        ({"inhibition": 127, "inhibition_exponent": 3}, "inhibition 1016 are synapses"),
    ],
)
def test_what_no_synapse_holds_is_refused(changes: dict[str, int], said: str) -> None:
    with pytest.raises(NetworkLimitError, match=said):
        netx.held(replace(small().network, **changes))


def test_more_neurons_than_one_population_hears_are_refused() -> None:
    weights, bias = np.ones((3, 1025), np.int16), np.zeros(1025, np.int32)
    with pytest.raises(NetworkLimitError, match=r"1,025 neurons .* at most 1,024; export a smaller map"):
        netx.held(replace(small().network, weights=weights, bias=bias))


def test_there_and_back(file: Path, tmp_path: Path) -> None:
    """What comes back is the network that the file holds, with the references of the model."""
    path, runner = tmp_path / "m.lvpr", CliRunner()
    model = small()
    model_file.save(model, path)
    out = runner.invoke(main, ["export", str(path), "-o", str(tmp_path / "x.net")])
    assert out.exit_code == 0, out.output
    assert "rounded, by" in out.stderr
    assert (tmp_path / "x.net").read_bytes() == file.read_bytes()
    back = runner.invoke(main, ["import", str(tmp_path / "x.net"), "-o", str(tmp_path / "b.lvpr")])
    assert back.exit_code == 0, back.output
    made = integer_model(model_file.load(tmp_path / "b.lvpr"), "a test")
    held = netx.held(model.network)
    assert np.array_equal(made.network.weights, held.weights)
    assert np.array_equal(made.network.bias, held.bias)
    assert {**made.network.scalars, "inhibition": 0} == {**held.scalars, "inhibition": 0}
    assert made.network.lateral == held.lateral
    assert made.place_names == model.place_names
    assert np.array_equal(made.neuron_places(), model.neuron_places())
    other = runner.invoke(main, ["import", str(file), "-o", str(tmp_path / "c.lvpr"), "--like", str(path)])
    assert other.exit_code == 0, other.output
    assert np.array_equal(model_file.load(tmp_path / "c.lvpr").responses, made.responses)


def test_a_feed_forward_layer_is_read(file: Path) -> None:
    """As lava-dl exports one: no recurrence, no bias."""
    with h5py.File(file, "r+") as opened:
        layer = opened["layer/1"]
        del layer["type"], layer["weight_rec"], layer["bias"], opened["lava_vpr"], opened["layer/0"]
        layer.create_dataset("type", (1,), "S10", [b"dense"])
    drawn = NETX.read(file, TIME_STEP)
    assert drawn.inhibition == 0
    assert drawn.references is None
    assert drawn.weights.shape[1] == 9
    assert not drawn.bias.any()


def _set(name: str, value: Any) -> Callable[[h5py.File], None]:
    def change(opened: h5py.File) -> None:
        if name in opened:
            del opened[name]
        opened[name] = value

    return change


def _kind(name: str, word: bytes) -> Callable[[h5py.File], None]:
    def change(opened: h5py.File) -> None:
        del opened[name]
        opened.create_dataset(name, (1,), "S10", [word])

    return change


def _cell(name: str, at: tuple[int, ...], value: int) -> Callable[[h5py.File], None]:
    return lambda opened: opened[name].__setitem__(at, value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda opened: opened.__delitem__("layer"), "has no layers"),
        (_kind("layer/1/type", b"conv"), "has layers ['input', 'conv']"),
        (_kind("layer/1/neuron/type", b"RF_IZ"), "has no CUBA neurons"),
        (_set("layer/1/delay", np.ones(9)), "has synaptic delays"),
        (_set("layer/1/neuron/iDecay", 1024), "has decays 1024 and"),
        (_set("layer/1/neuron/vDecay", 5000), "and 5000; currents must last a step"),
        (_set("layer/1/neuron/vThMant", 1.5), "has a vThMant that is no whole number"),
        (_set("layer/1/bias", np.ones(4)), "has 4 biases for 9 neurons"),
        (_set("layer/1/bias", np.full(9, np.nan)), "has a bias that is no whole number"),
        (_set("layer/1/weight", np.ones(9)), "has no weight of 2 axes"),
        (_set("layer/1/weight_rec", np.ones((4, 4))), "recurrent weights of shape (4, 4) for 9 neurons"),
        (_cell("layer/1/weight_rec", (0, 1), 1), "has a recurrent edge other than one inhibitory neuron"),
        (_cell("layer/1/weight_rec", (0, 8), -1), "has a last neuron that does not take the same"),
        (_cell("layer/1/weight_rec", (8, 0), 1), "one inhibitory neuron that any spike fires"),
        (_cell("layer/1/weight", (8, 0), 1), "has inputs or biases of its inhibitory neurons"),
        (_set("layer/0/neuron/type", "CUBA"), "has neurons in its input layer"),
        (_set("lava_vpr/references", "here"), "has references that are no bytes"),
    ],
)
def test_other_files_are_refused_in_one_line(change: Callable[[h5py.File], None], said: str, file: Path) -> None:
    with h5py.File(file, "r+") as opened:
        change(opened)
    with pytest.raises(InputError) as caught:
        NETX.read(file, TIME_STEP)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
