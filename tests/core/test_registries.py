"""A decoder, an input, a neuron model, a backend and a board are added by a row each; commands and files know them."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.commands import CONFIG, PLACES, fails, figures, recall, run
from support.common.small_models import encoded, small_config, small_model

from lava_vpr import model as model_file
from lava_vpr.backends.interface import BackendRow, HostBackend, Presentations
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, DecoderConfig, LifNetwork, StdpLearning
from lava_vpr.deploy.boards.board import BOARDS, KAPOHO_BAY, Board
from lava_vpr.deploy.bundle import targets
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.bundle.targets import TARGETS, Target
from lava_vpr.encoding import encode_traverse
from lava_vpr.errors import BackendUnavailableError, ConfigError, ModelFileError
from lava_vpr.inputs.encoder import INPUTS, ChannelLayout, EncoderConfig, Input
from lava_vpr.matching.decoders import DECODERS, Decoder, Reading, in_every_variant, margin
from lava_vpr.matching.equations import ScoresOf
from lava_vpr.model import Model, integer_model
from lava_vpr.neurons.models import NEURONS, NeuronConstants, NeuronModel, State
from lava_vpr.recognition import count_query_spikes
from lava_vpr.synthetic.world import write_traverses
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

ROUTE = 5
SETTINGS = "[network]\nsteps = 128\n[learning]\nsteps = 120\nepochs = 4\n[decoder]\ndefault = 'dummy'\n"


def overlap(responses: NDArray[Any], reading: Reading) -> ScoresOf:
    """The number of pairs of a query's spike and a reference's spike of the same neuron."""
    return lambda spikes: (spikes.astype(np.int64) @ responses.astype(np.int64)).astype(np.float64)


DUMMY_DECODER = Decoder("dummy", title="overlap of spikes", confidence=margin, scores=in_every_variant(overlap))
DUMMY_INPUT = Input(
    "dummy",
    layout=lambda encoder: ChannelLayout(1, 14),
    sees="patch",
    activity=lambda patch, encoder: cv2.resize(patch, (14, 14)).reshape(-1).astype(np.float32),
    grey_levels=True,
    drawing="grey",
    legend="A quarter of the pixels.",
)


@pytest.fixture
def registered() -> Iterator[None]:
    DECODERS.register(DUMMY_DECODER)
    INPUTS.register(DUMMY_INPUT)
    yield
    DECODERS.remove("dummy")
    INPUTS.remove("dummy")


@pytest.mark.usefixtures("registered")
def test_rows_are_all_that_the_commands_need(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_traverses(tmp_path, ROUTE, 0)
    Path("settings.toml").write_text(SETTINGS)
    assert "dummy" in run("train", "--help").stdout
    run("train", "reference", "-o", "m.lvpr", "--config", "settings.toml", "--input", "dummy")
    table = run("eval", "m.lvpr", "query", "--json", "f.json", "--report", "r").stdout
    assert "dummy *" in table
    found = json.loads(Path("f.json").read_text())
    assert found["default_decoder"] == "dummy"
    assert list(found["decoders"]) == [*(name for name in DECODERS if name != "dummy"), "dummy"]
    page = Path("r/report.html").read_text(encoding="utf-8")
    for text in ("overlap of spikes", "A quarter of the pixels.", "196 (dummy)", 'alt="Weights of neuron'):
        assert text in page
    run("query", "m.lvpr", "query", "-o", "matches.csv")

    model = model_file.load(Path("m.lvpr"))
    queries = encode_traverse(open_traverse("query"), model.config.encoder)
    assert queries.activity.shape == (ROUTE, 196)
    counts, _ = count_query_spikes(model, queries)
    scores = overlap(model.responses, Reading())(counts)
    assert scores.any()
    ranks = (scores > scores[np.arange(ROUTE), np.arange(ROUTE)][:, None]).sum(axis=1)
    assert found["decoders"]["dummy"]["recall_at_n"]["5"] == np.mean(ranks < 5)

    INPUTS.remove("dummy")  # the file outlives the row
    with pytest.raises(ModelFileError, match=r"encoder\.kind is 'dummy', but must be one of orientation, frontend"):
        model_file.load(Path("m.lvpr"))
    INPUTS.register(DUMMY_INPUT)


def test_removed_rows_are_unknown_again() -> None:
    with pytest.raises(ConfigError, match=r"decoder\.default is 'dummy', but must be one of contrast"):
        Config(decoder=DecoderConfig(default="dummy"))
    with pytest.raises(ConfigError, match=r"encoder\.kind is 'dummy', but must be one of orientation"):
        EncoderConfig(kind="dummy")
    refusal = f"'dummy' is not one of {', '.join(map(repr, INPUTS))}"
    assert refusal in fails("train", "reference", "-o", "m.lvpr", "--input", "dummy", code=2)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"scores": {}}, "no score function for the variant vprsnn2022, vprsnn, printed"),
        ({"scores": {"vprsnn2022": overlap}}, "no score function for the variant vprsnn, printed"),
    ],
)
def test_a_decoder_without_a_variant_is_refused(part: dict[str, Any], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        DECODERS.register(replace(DUMMY_DECODER, **part))
    assert "dummy" not in DECODERS


def without_leak(constants: NeuronConstants, state: State, drive: State) -> tuple[State, NDArray[np.bool_]]:
    """Integrate and fire; what is above the threshold stays."""
    v = state[0] + drive
    spikes = v > constants.threshold
    return (v - constants.threshold * spikes)[None], spikes


@pytest.fixture
def neurons() -> Iterator[None]:
    """With the neuron model ``dummy``."""
    NEURONS.register(NeuronModel("dummy", "without leak", without_leak))
    yield
    NEURONS.remove("dummy")


@pytest.mark.usefixtures("here", "neurons")
def test_commands_use_a_new_neuron_model() -> None:
    Path("n.toml").write_text(CONFIG.replace("[network]\n", "[network]\nmodel = 'dummy'\n"))
    run("train", "reference", "-o", "n.lvpr", "--config", "n.toml")
    ours, lif = (model_file.load(Path(name)) for name in ("n.lvpr", "m.lvpr"))
    assert np.array_equal(ours.learned, lif.learned)
    assert ours.responses.sum() > 1.2 * lif.responses.sum()
    run("eval", "n.lvpr", "query", "--json", "e.json")
    assert recall(json.loads(Path("e.json").read_text())) >= 1 - 2 / PLACES
    run("verify", "n.lvpr", "query", "--limit", 2, "--json", "v.json")
    verdicts = json.loads(Path("v.json").read_text())["backends"]
    assert verdicts.pop("host")["spikes_decided"] > 0
    assert set(verdicts) == set(BACKENDS) - {"host"}
    needs = "needs neurons of network.model lif, but these are dummy (without leak), which only --backend host runs; "
    for name, verdict in verdicts.items():
        assert verdict["available"] is False
        if BACKENDS[name].unavailable() is None:
            assert verdict["reason"] == f"{name} {needs}train with lif"
    for what, words in {
        "Kapoho Bay": ("deploy", "n.lvpr", "--target", "kapoho-bay", "-o", "b"),
        "Loihi 2": ("fit", "n.lvpr", "--target", "loihi2"),
        "bench": ("bench", "n.lvpr", "query"),
        "format nir": ("export", "n.lvpr", "-o", "n.nir"),
    }.items():
        line = fails(*words)
        assert line.startswith(f"n.lvpr: {what} ")
        assert line.endswith(f" {needs}train with lif")
    assert not Path("b").exists()
    assert fails("eval", "n.lvpr", "query", "--backend", "bundle").startswith(f"bundle {needs}")
    with pytest.raises(ConfigError, match=r"^Kapoho Bay .* needs neurons of network\.model lif"):
        plan_of(integer_model(ours, "a test"), KAPOHO_BAY)
    with pytest.raises(ConfigError, match=r"^learning\.rule slayer needs neurons of network\.model lif"):
        train([encoded()], replace(small_config(), network=ours.config.network, learning=StdpLearning(rule="slayer")))


@pytest.mark.usefixtures("neurons")
def test_a_network_of_other_neurons_than_the_settings_say_is_refused() -> None:
    header, arrays = model_file.content(small_model(), network=False)
    header["config"]["network"]["model"] = "dummy"
    with pytest.raises(ModelFileError, match=r"neurons of the model lif where the settings say dummy"):
        model_file.assemble(Path("a"), header, arrays, integer_model(small_model(), "a test").network)


def test_a_neuron_model_that_was_removed_is_unknown() -> None:
    for name in ("dummy", "conductance"):
        with pytest.raises(
            ConfigError,
            match=f"^network.model is '{name}', but must be lif, or install the package that has it among its entry "
            "points lava_vpr.neuron_models;",
        ):
            LifNetwork(model=name)


class Dummy(HostBackend):
    """The host once more; it says what it does."""

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], dict[str, int]]:
        logging.getLogger("lava_vpr").warning("the dummy counts %d queries", len(shown.rates))
        return super().count_spikes(model, shown)


DUMMY_BACKEND = BackendRow(
    "dummy",
    "the host once more",
    make=lambda threads, advance: Dummy(Pool(threads)),
    unavailable=lambda: None,
    counts_only=True,
)
DUMMY_BOARD = replace(KAPOHO_BAY, name="dummy", title="Dummy", chips=1, cores=4, compartments=30)
DUMMY_TARGET = replace(TARGETS["kapoho-bay"], name="dummy")


@pytest.fixture
def backend() -> Iterator[None]:
    """With the backend ``dummy``."""
    BACKENDS.register(DUMMY_BACKEND)
    yield
    BACKENDS.remove("dummy")


@pytest.fixture
def board() -> Iterator[None]:
    """With the board ``dummy``."""
    BOARDS.register(DUMMY_BOARD)
    TARGETS.register(DUMMY_TARGET)
    yield
    TARGETS.remove("dummy")
    BOARDS.remove("dummy")


@pytest.mark.usefixtures("here", "backend")
def test_commands_use_a_new_backend() -> None:
    assert figures("query", "--backend", "dummy") == figures("query")
    told = run("eval", "m.lvpr", "query", "--backend", "dummy").stderr
    assert f"note: the dummy counts {PLACES} queries\n" in told
    result = run("verify", "m.lvpr", "query", "--limit", 2, "--backend", "dummy", "--json", "v.json")
    assert "every spike equal" in result.stdout
    verdict = json.loads(Path("v.json").read_text())["backends"]["dummy"]
    assert (verdict["available"], verdict["equal"], verdict["queries"]) == (True, True, 2)
    assert "the host once more" in run("doctor").stdout


@pytest.mark.usefixtures("here")
def test_a_backend_that_was_removed_is_unknown() -> None:
    assert "'dummy' is not one of 'host', 'lava-fixed'" in fails(
        "eval", "m.lvpr", "query", "--backend", "dummy", code=2
    )
    with pytest.raises(BackendUnavailableError, match=r"^there is no backend 'dummy'; choose from host, lava-fixed"):
        BACKENDS["dummy"]


@pytest.mark.usefixtures("here", "board")
def test_commands_use_a_new_board() -> None:
    assert "bits a weight" in run("fit", "--target", "dummy", "--weight-bits", 3).stdout
    run("fit", "m.lvpr", "--target", "dummy", "--json", "f.json")
    placed = json.loads(Path("f.json").read_text())
    assert placed["target"] == "dummy"
    assert all(sum(part["size"] for part in core["parts"]) <= 30 for core in placed["mapping"]["cores"])
    run("deploy", "m.lvpr", "--target", "dummy", "-o", "b")
    manifest = json.loads(Path("b/manifest.json").read_text())
    assert (manifest["target"], manifest["limits"]["cores"]) == ("dummy", 4)
    assert "# A place network for Dummy\n" in Path("b/README.md").read_text()
    result = run("verify", "b", "query", "--limit", 2, "--backend", "bundle")
    assert "every spike equal" in result.stdout


@pytest.mark.usefixtures("here")
def test_a_board_that_was_removed_is_unknown() -> None:
    assert "'dummy' is not one of 'kapoho-bay', 'loihi2'" in fails("fit", "m.lvpr", "--target", "dummy", code=2)


def test_a_board_without_a_target_is_refused() -> None:
    assert set(TARGETS) == set(BOARDS)
    BOARDS.register(DUMMY_BOARD)
    try:
        with pytest.raises(TypeError, match=r"^board 'dummy' has no target; register one in lava_vpr\.deploy\.bundle"):
            targets.check_targets()
    finally:
        BOARDS.remove("dummy")


def test_every_row_is_complete() -> None:
    assert all(isinstance(row, Board) for row in BOARDS.values())
    assert all(isinstance(row, Target) for row in TARGETS.values())
    assert {row.board for row in BACKENDS.values()} - {None} <= set(BOARDS)
    assert next(iter(BACKENDS)) == "host"
