"""Files altered in one place and sealed again: each breaks what its format declares, and is refused in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fuzz import run
from support.fuzz.changes import MANIFEST, REFERENCES, Files, held, sealed, sealed_bundle, stored, taken_apart, zipped
from support.fuzz.corpus import PLACES, Corpus

from lava_vpr import maps
from lava_vpr import model as model_file
from lava_vpr.backends.asking import open_model

Arrays = dict[str, Any]
Change = Callable[[Any, Arrays], object]


def altered(data: bytes, change: Change) -> bytes:
    """A container whose header and arrays ``change`` has altered, sealed again."""
    magic, entries = taken_apart(data)
    header = json.loads(held(dict(entries)["header.npy"]).tobytes())
    arrays = {name: held(content) for name, content in entries if name != "header.npy"}
    change(header, arrays)
    again = [("header.npy", stored(np.frombuffer(json.dumps(header).encode(), np.uint8)))]
    return sealed(magic, zipped([*again, *((name, stored(array)) for name, array in arrays.items())]))


def put(name: str, at: Any, value: Any) -> Change:
    """Another number in an array."""
    return lambda header, held: held[f"a.{name}.npy"].__setitem__(at, value)


def become(name: str, dtype: str) -> Change:
    """Another type of an array."""
    return lambda header, held: held.update({f"a.{name}.npy": held[f"a.{name}.npy"].astype(dtype)})


def older(value: int) -> Change:
    """Responses in 32 bits, as older files have them, with another number in front."""

    def change(header: Any, held: Arrays) -> None:
        become("responses", "i4")(header, held)
        put("responses", (0, 0), value)(header, held)

    return change


def at_places(frame: object, corner: Any, dtype: str = "f8") -> Change:
    """Positions, the first of them at ``corner``."""

    def change(header: Any, held: Arrays) -> None:
        header["frame"] = frame
        held["a.positions.npy"] = np.full((PLACES, 2), 50, dtype)
        held["a.positions.npy"][0] = corner

    return change


def tell(*keys: str, value: Any) -> Change:
    """Another value in the header."""

    def change(header: Any, held: Arrays) -> None:
        for key in keys[:-1]:
            header = header[key]
        header[keys[-1]] = value

    return change


MODELS: list[tuple[str, Change]] = [
    ("float", lambda header, held: held.update({"b.npy": np.zeros(1)})),
    ("float", lambda header, held: held.update({"a.labels.npy": np.zeros(12, "S4")})),
    *(("float", put("network.weights", (0, 0), value)) for value in (32, -32)),
    ("float", become("network.weights", "i4")),
    ("float", tell("fixed", "signed", value=0)),
    ("float", become("network.bias", "i8")),
    *(("float", put("network.bias", 0, value)) for value in (-(2**31), 4095 << 7, 4097)),
    ("float", tell("fixed", "decay", value=4097)),
    ("float", tell("fixed", "steps", value=30)),
    ("float", tell("fixed", "regular", value=0)),
    ("float", tell("fixed", "signed", value=True)),
    ("bias", tell("fixed", "bias_input", value=0)),
    ("bias", tell("fixed", "regular", value=0)),
    ("pixels", lambda header, held: held["a.network.weights.npy"].fill(255)),
    ("pixels", lambda header, held: held["a.network.weights.npy"].fill(-255)),
    ("float", tell("stretches", value=[[0, 3, 0, 3, 0], [3, 3, 3, 2, 0]])),
    ("views", lambda header, held: header["stretches"][3].__setitem__(4, 0)),
    ("views", lambda header, held: header["stretches"].pop()),
    ("views", lambda header, held: header["stretches"][0].append(1)),
    ("float", tell("stretches", value=[[0, 3, 0, 3, 0, 0], [3, 3, 3, 3, 0]])),
    ("float", tell("stretches", value=[[0, 3, 0, 5, 0, 1], [3, 3, 5, 1, 0, 1]])),
    ("float", tell("stretches", value=[[0, 3, 0, 3, 0, 1, 1], [3, 3, 3, 3, 0]])),
    ("views", put("labels", 7, 0)),
    ("float", put("place_indices", 1, 0)),
    ("float", tell("route_images", value=PLACES - 1)),
    ("float", put("labels", 1, 0)),
    ("float", put("activity", (0, 0), np.nan)),
    ("pixels", put("activity", (0, 0), 256)),
    ("float", put("responses", (0, 0), 65)),
    ("paper", older(-1)),
    ("float", become("responses", "u4")),
    ("float", become("patches", "i2")),
    ("float", put("learned", (0, 0), -1e-6)),
    ("float", lambda header, held: header["place_names"].__setitem__(0, "a\0b")),
    ("float", tell("training", "neurons_used", value="many")),
    ("paper", put("network.delays", (0, 0), 101)),
    ("paper", put("network.theta_mv", 0, np.inf)),
    ("float", at_places("latlon", (91, 0))),
    ("float", at_places("xy", (0, np.nan))),
    ("float", at_places("UTM 61N", 0)),
    ("float", at_places("xy", 0, "f4")),
    ("float", tell("frame", value="xy")),
]


CHECKPOINTS: list[tuple[str, Change]] = [
    ("float", tell("fingerprint", value="0" * 64)),
    ("float", tell("epochs", "0", value=4)),
    ("float", tell("epochs", "0", value=2.0)),
    ("float", tell("epochs", "2", value=1)),
    ("float", become("0.weights", "f8")),
    ("float", lambda header, held: held.pop("a.0.theta.npy")),
    ("float", lambda header, held: held.update({"a.2.theta.npy": held["a.0.theta.npy"]})),
    ("float", put("0.weights", (0, 0), np.nan)),
    ("integer", put("1.theta", 0, 0)),
    ("paper", put("0.delays", (0, 0), 102)),
    ("paper", put("0.responses", (0, 0), 601)),
]


CORE = "cores/chip0-core000/"
STRETCH = "learning/stretch000/"


def array(name: str, at: Any, value: Any) -> Callable[[Files], Files]:
    """Another number in a file of a bundle, sealed."""

    def change(files: Files) -> Files:
        own = held(files[name])
        own[at] = value
        return sealed_bundle(files | {name: stored(own)})

    return change


def value(name: str, *keys: Any, to: Any) -> Callable[[Files], Files]:
    """Another value in a JSON file of a bundle, sealed."""

    def change(files: Files) -> Files:
        whole = json.loads(files[name])
        tell(*keys, value=to)(whole, {})
        if name == MANIFEST:
            return sealed_bundle(files, whole)
        return sealed_bundle(files | {name: json.dumps(whole).encode()})

    return change


def references(change: Change) -> Callable[[Files], Files]:
    """Other references, sealed."""
    name = REFERENCES
    return lambda files: sealed_bundle(files | {name: altered(files[name], change)})


BUNDLES: list[tuple[str, Callable[[Files], Files]]] = [
    ("loihi2", lambda files: files | {"manifest.json": files["manifest.json"].replace(b"loihi2", b"loihi3")}),
    ("loihi2", value("manifest.json", "version", to=True)),
    ("loihi2", lambda files: files | {"host/rates.npy": files["host/rates.npy"] + b"x"}),
    ("loihi2", lambda files: sealed_bundle(files | {"back\\slash": b""})),
    ("loihi2", value("manifest.json", "network", "silent_steps", to=4)),
    ("loihi2", references(put("labels", 1, 0))),
    ("loihi2", array("host/labels.npy", 0, 1)),
    ("loihi2", lambda files: sealed_bundle({n: d for n, d in files.items() if n != "host/rates.npy"})),
    ("kapoho-bay", value(CORE + "registers.json", "cxProfileCfg", 0, "decayV", to=4096)),
    ("kapoho-bay", array(CORE + "compartments.npy", (0, 0), 9)),
    ("kapoho-bay-bias", array(CORE + "compartments.npy", (0, 3), 8)),
    ("kapoho-bay", array(CORE + "compartments.npy", (0, 2), -4096)),
    ("kapoho-bay", array(CORE + "axons_in.npy", (0, 0), 1)),
    ("kapoho-bay", array(CORE + "synapses.npy", 0, 15)),
    ("kapoho-bay", array("host/exc.npy", (0, 2), 1)),
    ("kapoho-bay", array(CORE + "axons_out.npy", (0, 3), 4000)),
    ("kapoho-bay", array("host/injection.npy", (0, 3), 4000)),
    ("kapoho-bay", array("host/injection.npy", (0, 0), 1)),
    ("kapoho-bay", array(CORE + "compartments.npy", (-1, 2), 1)),
    ("loihi2", value("network/parameters.json", "exc", "vth", to=1)),
    ("loihi2", value("network/parameters.json", "more", to=1)),
    ("loihi2-learning", array(STRETCH + "thresholds.npy", 0, 0)),
    ("loihi2-learning", array(STRETCH + "images.npy", 0, 12)),
    ("loihi2-learning", value("learning/learning.json", "stretches", 0, "rng_seeds", 0, to=-1)),
    ("loihi2-learning", value("learning/learning.json", "stretches", 0, "phases", 0, "steps", to=10**9)),
]


CONTAINERS = [("model", *row) for row in MODELS] + [("checkpoint", *row) for row in CHECKPOINTS]


@pytest.mark.parametrize(("kind", "name", "change"), CONTAINERS, ids=range(len(CONTAINERS)))
def test_containers(honest: Corpus, kind: str, name: str, change: Change) -> None:
    files = {file: altered(data, change) for file, data in honest.files[kind][name].items()}
    kind, told = run.tried(run.Case(kind, name, files), honest)
    assert kind == run.REFUSED, told


@pytest.mark.parametrize(("name", "change"), BUNDLES, ids=range(len(BUNDLES)))
def test_bundles(honest: Corpus, name: str, change: Callable[[Files], Files]) -> None:
    kind, told = run.tried(run.Case("bundle", name, change(honest.files["bundle"][name])), honest)
    assert kind == run.REFUSED, told


@pytest.mark.parametrize(
    ("name", "part", "change"),
    [
        ("kapoho-bay", "bias", array(CORE + "compartments.npy", (0, 2), 1)),
        ("loihi2", "weights", array("network/weights.npy", (0, 0), 224)),
    ],
)
def test_what_a_board_gets_is_what_is_read(honest: Corpus, name: str, part: str, change: Any) -> None:
    before, case = open_model(honest.folder / name), run.Case("bundle", name, change(honest.files["bundle"][name]))
    assert run.tried(case, honest) == (run.SOUND, "")
    after = open_model(honest.folder / "work" / "bundle")
    assert (getattr(before.network, part) != getattr(after.network, part)).sum() == 1


@pytest.mark.parametrize("name", ["float", "views"])
def test_models_that_lost_places(honest: Corpus, name: str, tmp_path: Path) -> None:
    """What is left of a model is equal when it is written again, and so is what it is merged to."""
    whole = model_file.load(honest.folder / f"{name}.lvpr")
    less = maps.remove(whole, [0, 4])
    for made in (less, maps.merge([less, whole])):
        model_file.save(made, tmp_path / "m.lvpr")
        case = run.Case("model", name, {"m.lvpr": (tmp_path / "m.lvpr").read_bytes()})
        assert run.tried(case, honest) == (run.SOUND, "")
        assert any(part.removed for part in made.stretches)
