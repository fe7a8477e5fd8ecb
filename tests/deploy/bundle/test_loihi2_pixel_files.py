"""A network from pixels to places in a bundle for Loihi 2: whole in its files, played from them alone, and refused
where it is another's."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.boards.loihi2_bundles import SPEC, hearing, pictures
from support.common.small_models import encoded, small_config

from lava_vpr.backends.deployed import front_end_trains
from lava_vpr.backends.interface import front_end_of
from lava_vpr.cluster.tasks import Pool
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.bundle import folder as bundle_folder, loihi2_pixels
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.deploy.bundle.folder import ReadBundle, array_bytes
from lava_vpr.deploy.bundle.front_end import held_sentence
from lava_vpr.deploy.bundle.targets import open_whole
from lava_vpr.deploy.hardware.table import BELIEFS
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.engine.inference.whole import WholeNetwork, counts_of
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.errors import BundleError, NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.model import IntegerModel, integer_model
from lava_vpr.training.loop import train

PLACES = 5


def read(spec: WholeNetwork, **changes: bytes) -> ReadBundle:
    """A bundle of the network's files alone."""
    files, facts = loihi2_pixels.whole_files(spec)
    return ReadBundle(Path("b"), {"front_end": facts}, files | changes)


def played(
    bundle: ReadBundle, shown: NDArray[np.uint8], bias: NDArray[np.int32] | None = None
) -> Mapping[str, NDArray[np.uint8]]:
    """Every spike of a bundle."""
    play = loihi2_pixels.player(bundle)
    assert play is not None
    return play(PixelBlock(shown, bias))


def equal(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> bool:
    """Whether every spike is the same."""
    assert list(found) == list(wanted)
    return all(np.array_equal(found[name], film) for name, film in wanted.items())


@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 1 << 32),
    levels=st.integers(2, 20),
    race=st.integers(2, 14),
    reading=st.integers(1, 16),
    exponent=st.integers(0, 7),
    decay=st.integers(0, 4095),
)
def test_every_spike_of_the_files_is_the_hosts(
    seed: int, levels: int, race: int, reading: int, exponent: int, decay: int
) -> None:
    """Of pictures, one after another, in presentations that are filled up to a power of two of steps."""
    spec = FrontEnd(8, levels=levels, race=race, budget=40, reading=reading)
    heard = hearing(spec, seed, inhibition_exponent=exponent, decay=decay)
    shown, bias = pictures(2, seed, spec), -(np.arange(14, dtype=np.int32).reshape(2, 7) << 8)
    assert equal(played(read(heard), shown), heard.trains(shown))
    assert equal(played(read(heard), shown, bias), heard.trains(shown, bias))


@pytest.mark.parametrize("levels", [20, 37])
def test_every_grey_level_spikes_once_in_the_longest_presentation(levels: int) -> None:
    """What silences itself has not recovered when neurons are reset, whatever its bias."""
    spec = FrontEnd(32, levels=levels, race=10, reading=12)
    assert spec.steps in (47, 64)
    shown = np.arange(512).reshape(1, 16, 32).astype(np.uint8)
    films = played(read(hearing(spec)), shown)
    for name in ("clock", "pixels"):
        assert (films[name].sum(axis=1) == 1).all(), name
    assert equal(films, hearing(spec).trains(shown))
    assert films["exc"].any()


def test_a_spike_in_a_silent_step_is_refused() -> None:
    """The clock's first neuron, which does not silence itself."""
    told = json.loads(loihi2_pixels.whole_files(hearing())[0][loihi2_pixels.PARAMETERS])
    told["synapses"] = [one for one in told["synapses"] if (one["source"], one["target"]) != ("clock", "clock")]
    changed = read(hearing(), **{loihi2_pixels.PARAMETERS: json.dumps(told).encode()})
    with pytest.raises(BundleError, match=r"^b/network/parameters.json: a neuron spikes in a silent step; "):
        played(changed, pictures(1))


def test_parameters_have_the_names_of_lavas_arguments() -> None:
    files, facts = loihi2_pixels.whole_files(hearing())
    assert facts == {"steps": 39, "interval": 64, "populations": hearing().populations}
    told = json.loads(files[loihi2_pixels.PARAMETERS])
    assert (told["steps"], told["silent_steps"]) == (39, 25)
    assert list(told["populations"]) == list(hearing().populations)
    reset = {"reset_interval": 64, "reset_offset": 1}
    assert told["populations"]["pixels"] == {
        **{"shape": [32], "du": 4095, "dv": 0, "vth": 209, "bias_mant": 0, "bias_exp": 6},
        **reset,
    }
    assert told["populations"]["clock"]["bias_mant"] == [1] + [0] * SPEC.ticks
    mantissas, exponent = bias_registers(hearing().places.bias)
    assert told["populations"]["exc"] == {
        **{"shape": [7], "du": 0, "dv": 4095, "vth": 20},
        **{"bias_mant": mantissas.tolist(), "bias_exp": int(exponent)},
        **reset,
    }
    assert min(one["vth"] for one in told["populations"].values()) == 1
    last = told["synapses"][-1]
    form = {"num_weight_bits": 8, "weight_exp": 0, "sign_mode": "INHIBITORY"}
    assert (last["source"], last["target"], last["form"]) == ("inh", "exc", form)
    weights = bundle_array(files, f"network/{last['name']}/weights.npy")
    assert weights.tolist() == [-48] * 7


def bundle_array(files: Mapping[str, bytes], name: str) -> Any:
    return ReadBundle(Path("b"), {}, dict(files)).array(name)


def test_what_lif_reset_does_not_take_is_refused() -> None:
    with pytest.raises(NetworkLimitError, match=r"^decay 4096 does not fit Loihi 2's 0\.\.4095; "):
        loihi2_pixels.whole_files(hearing(decay=4096))


@lru_cache(maxsize=1)
def model() -> IntegerModel:
    """A model whose neurons hear the cells, of five blurred pictures."""
    config = small_config(encoder={"kind": "frontend-direct"}, learning={"rule": "template"})
    spec, rng = config.encoder.direct, np.random.default_rng(3)
    assert spec is not None
    small = rng.integers(0, 256, (PLACES, 6, 8, 3)).astype(np.uint8)
    shown = np.array([cv2.resize(one, (64, 48), interpolation=cv2.INTER_LINEAR) for one in small])
    activity = np.array([spec.bursts(one).reshape(-1) for one in shown])
    traverse = replace(encoded(PLACES, activity.shape[1]), activity=activity, thumbnails=shown)
    return integer_model(train([traverse], config, pool=Pool(2)), "a test")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its bundle for Loihi 2; never written to."""
    return deploy(model(), LOIHI_2, tmp_path_factory.mktemp("pixels") / "bundle").bundle.path


def test_a_bundle_is_opened_as_the_model_that_was_deployed(written: Path) -> None:
    bundle, opened = open_whole(written)
    own, told = integer_model(opened, "a test"), bundle.manifest
    assert np.array_equal(own.network.weights, model().network.weights)
    assert own.network.scalars == model().network.scalars
    assert told["clearing"]["reset_interval"] == told["front_end"]["interval"] == 64
    assert "neurons are reset every 64." in held_sentence(told["front_end"])
    assert list(bundle.json("mapping.json")["populations"]) == list(whole().populations)  # there are no counters
    counts = bundle.array("host/counts.npy")
    assert np.array_equal(counts, counts_of(whole(), bundle.array("host/pixels.npy")))
    assert (counts.argmax(axis=1) == np.arange(PLACES)).all()


def test_its_readme_tells_what_it_rests_on_and_takes(written: Path) -> None:
    bundle = bundle_folder.load(written)
    readme = bundle.files["README.md"].decode()
    assert "Q/pixels.npy uint8 (n, 32, 64) in" in readme
    for name in (
        "bias_mant, bias_exp and v are written while the run is paused",
        "the longest interval between two resets",
    ):
        assert name in bundle.manifest["unproven"]
        assert f"- {name}: if it is wrong, {BELIEFS[name].breaks}\n" in readme


def whole() -> WholeNetwork:
    """The model's front end with its network."""
    spec = front_end_of(model())
    assert isinstance(spec, WholeNetwork)
    return spec


def test_backend_bundle_plays_it(written: Path) -> None:
    bundle, opened = open_whole(written)
    shown = bundle.array("host/pixels.npy")[:2]
    (films,) = front_end_trains(opened, [PixelBlock(shown)])
    assert equal(films, whole().trains(shown))
    assert films["exc"].any()


def altered(written: Path, path: Path, board: Board, change: dict[str, Any], files: dict[str, bytes]) -> Path:
    """The bundle with another manifest and other files, sealed again."""
    old = bundle_folder.load(written)
    told = {name: value for name, value in old.manifest.items() if name not in ("format", "version", "files", "sha256")}
    bundle_folder.write(path, {**told, **change, "target": board.name}, {**old.files, **files})
    return path


ROWS = "network/00-clock-clock/weights.npy"


@pytest.mark.parametrize(
    ("change", "files", "said"),
    [
        ({}, {ROWS: array_bytes(np.full(47, 3, np.int16))}, f"{ROWS}: contradicts the rest"),
        ({}, {"network/parameters.json": b"{}"}, "network/parameters.json: contradicts the rest"),
        ({}, {"network/more.npy": b""}, "network/more.npy: is no part of the network"),
        ({}, {"host/counts.npy": array_bytes(np.zeros((PLACES, PLACES), np.int32))}, "host/counts.npy: contradicts"),
        ({"front_end": {"steps": 50}}, {}, "manifest.json: what it says of a front end is not what its settings make"),
    ],
)
def test_other_files_are_refused(
    written: Path, tmp_path: Path, change: dict[str, Any], files: dict[str, bytes], said: str
) -> None:
    path = altered(written, tmp_path / "bundle", LOIHI_2, change, files)
    with pytest.raises(BundleError, match=f"^{path}/{said}"):
        open_whole(path)


def test_another_boards_files_are_refused(written: Path, tmp_path: Path) -> None:
    path = altered(written, tmp_path / "bundle", KAPOHO_BAY, {"limits": {"host_spikes": 0}}, {})
    with pytest.raises(BundleError, match=r"manifest.json: what it says of a front end is not what its settings make"):
        open_whole(path)
