"""The checker of accepted files finds each rule broken, whatever the program's readers say."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fuzz.files import archives, arrays, bundles, containers, corpus, lists, readers
from support.fuzz.files.corpus import PLACES, SETTINGS, Corpus
from support.fuzz.soundness import bundles as bundle_rules
from support.fuzz.soundness import checkpoints, models, settings
from support.fuzz.soundness import lists as list_rules
from support.fuzz.soundness.rules import INVARIANTS, Findings

from lava_vpr import maps
from lava_vpr import model as model_file
from lava_vpr.config import PRESETS
from lava_vpr.configfile import to_dict
from lava_vpr.deploy.bundle.opening import open_bundle

Arrays = dict[str, Any]
Change = Callable[[Any, Arrays], object]


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Corpus:
    """The honest files."""
    return corpus.make(tmp_path_factory.mktemp("honest"))


def altered(data: bytes, change: Change) -> bytes:
    """A container whose header and arrays ``change`` has altered, sealed again."""
    magic, entries = containers.taken_apart(data)
    header = containers.header_of(entries)
    held = {name: np.array(arrays.read(content)) for name, content in entries if name != "header.npy"}
    change(header, held)
    stored = arrays.stored(np.frombuffer(json.dumps(header).encode(), np.uint8))
    again = [("header.npy", stored), *((name, arrays.stored(array)) for name, array in held.items())]
    return containers.sealed(magic, archives.zipped(again))


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


MODELS: list[tuple[str, str, Change]] = [
    ("F2", "float", lambda header, held: held.update({"b.npy": np.zeros(1)})),
    ("F3", "float", lambda header, held: held.update({"a.labels.npy": np.zeros(12, "S4")})),
    ("T4", "float", tell("config", "seed", value=5)),
    *(("M2", "float", put("network.weights", (0, 0), value)) for value in (32, -32)),
    ("M2", "float", become("network.weights", "i4")),
    ("M2", "float", tell("fixed", "signed", value=0)),
    ("M2", "float", become("network.bias", "i8")),
    *(("M2", "float", put("network.bias", 0, value)) for value in (-(2**31), 4095 << 7, 4097)),
    ("M3", "float", tell("fixed", "decay", value=4097)),
    ("M3", "float", tell("fixed", "steps", value=30)),
    ("M3", "float", tell("fixed", "regular", value=0)),
    ("M3", "float", tell("fixed", "signed", value=True)),
    ("M3", "bias", tell("fixed", "bias_input", value=0)),
    ("M3", "bias", tell("fixed", "regular", value=0)),
    ("M4", "pixels", lambda header, held: held["a.network.weights.npy"].fill(255)),
    ("M4", "pixels", lambda header, held: held["a.network.weights.npy"].fill(-255)),
    ("M5", "float", tell("stretches", value=[[0, 3, 0, 3, 0], [3, 3, 3, 2, 0]])),
    ("M5", "views", lambda header, held: header["stretches"][3].__setitem__(4, 0)),
    ("M5", "views", lambda header, held: header["stretches"].pop()),
    ("M5", "views", lambda header, held: header["stretches"][0].append(1)),
    ("M5", "float", tell("stretches", value=[[0, 3, 0, 3, 0, 0], [3, 3, 3, 3, 0]])),
    ("M5", "float", tell("stretches", value=[[0, 3, 0, 5, 0, 1], [3, 3, 5, 1, 0, 1]])),
    ("M5", "float", tell("stretches", value=[[0, 3, 0, 3, 0, 1, 1], [3, 3, 3, 3, 0]])),
    ("M7", "views", put("labels", 7, 0)),
    ("M6", "float", put("place_indices", 1, 0)),
    ("M6", "float", tell("route_images", value=PLACES - 1)),
    ("M7", "float", put("labels", 1, 0)),
    ("M8", "float", put("activity", (0, 0), np.nan)),
    ("M8", "pixels", put("activity", (0, 0), 256)),
    ("M9", "float", put("responses", (0, 0), 65)),
    ("M9", "paper", older(-1)),
    ("M9", "float", become("responses", "u4")),
    ("M10", "float", become("patches", "i2")),
    ("M11", "float", put("learned", (0, 0), -1e-6)),
    ("M12", "float", lambda header, held: header["place_names"].__setitem__(0, "a\0b")),
    ("M12", "float", tell("training", "neurons_used", value="many")),
    ("M13", "paper", put("network.delays", (0, 0), 101)),
    ("M13", "paper", put("network.theta_mv", 0, np.inf)),
    ("M15", "float", at_places("latlon", (91, 0))),
    ("M15", "float", at_places("xy", (0, np.nan))),
    ("M15", "float", at_places("UTM 61N", 0)),
    ("M15", "float", at_places("xy", 0, "f4")),
    ("M15", "float", tell("frame", value="xy")),
    ("M14", "float", put("thumbnails", (0, 0, 0, 0), 1)),
]


@pytest.mark.parametrize(
    ("rule", "name", "change"), MODELS, ids=[f"{rule}-{k}" for k, (rule, _, _) in enumerate(MODELS)]
)
def test_models(honest: Corpus, rule: str, name: str, change: Change) -> None:
    view = readers.view(model_file.load(honest.folder / f"{name}.lvpr"))
    assert models.check_model(honest.models[name], view) == []
    assert found(models.check_model(altered(honest.models[name], change), view), rule)


@pytest.mark.parametrize("name", ["float", "views"])
def test_models_that_lost_places(honest: Corpus, name: str, tmp_path: Path) -> None:
    """What is left of a model satisfies every rule, and so does what it is merged to."""
    whole = model_file.load(honest.folder / f"{name}.lvpr")
    less = maps.remove(whole, [0, 4])
    for made in (less, maps.merge([less, whole])):
        model_file.save(made, tmp_path / "m.lvpr")
        view = readers.view(model_file.load(tmp_path / "m.lvpr"))
        assert models.check_model((tmp_path / "m.lvpr").read_bytes(), view) == []
        assert any(len(row) == 6 for row in view["stretches"])


def found(findings: Findings, rule: str) -> bool:
    """Whether ``rule`` is among what was found."""
    return rule in {finding.split(":")[0] for finding in findings}


def test_containers(honest: Corpus) -> None:
    view = readers.view(model_file.load(honest.folder / "float.lvpr"))
    data = honest.models["float"]
    assert found(models.check_model(data[:-1], view), "F1")
    magic, _, payload = data.split(b"\n", 2)
    assert found(models.check_model(containers.sealed(b"lava-vpr model 2", payload), view), "F1")
    for more in (b"junk" + payload, payload + b"junk", payload + payload):
        assert found(models.check_model(containers.sealed(magic, more), view), "F2")


SETTINGS_CHANGES: list[tuple[str, str, str, Any]] = [
    ("T1", "network", "steps", 32.0),
    ("T1", "network", "steps", True),
    ("T1", "network", "more", 1),
    ("T1", "network", "signed", 1),
    ("T2", "network", "trains", "random"),
    ("T2", "network", "steps", 0),
    ("T2", "network", "prune", 1.0),
    ("T2", "learning", "mu", float("nan")),
    ("T2", "decoder", "default", "best"),
    ("T3", "encoder", "cell", 3),
    ("T3", "network", "steps", 31),
    ("T3", "network", "weight_bits", 8),
    ("T3", "encoder", "window", 4),
    ("T2", "views", "scale", 0.9),
    ("T3", "views", "shifts", 2),
    ("T3", "views", "shifts", 41),
    ("T3", "learning", "mean_weight", 3.0),
    ("T3", "learning", "start_weight", 3.0),
]


@pytest.mark.parametrize(("rule", "section", "key", "value"), SETTINGS_CHANGES)
def test_settings(rule: str, section: str, key: str, value: Any) -> None:
    config, findings = json.loads(json.dumps(to_dict(SETTINGS["float"]))), Findings()
    assert settings.check(config, findings)
    config[section][key] = value
    settings.check(config, findings)
    assert found(findings, rule)


def test_what_toml_says_is_what_is_returned(honest: Corpus) -> None:
    presets = {name: to_dict(make()) for name, make in PRESETS.items()}
    config, text = to_dict(SETTINGS["float"]), honest.texts["float"]
    assert settings.check_toml(text, config, presets) == []
    assert found(settings.check_toml(text.replace(b"steps = 32", b"steps = 16"), config, presets), "T4")
    assert found(settings.check_toml(text.replace(b"steps = 32", b""), config, presets), "T4")
    assert found(settings.check_toml(text.replace(b"=", b":"), config, presets), "T1")


CHECKPOINTS: list[tuple[str, str, Change]] = [
    ("C1", "float", tell("fingerprint", value="0" * 64)),
    ("C2", "float", tell("epochs", "0", value=4)),
    ("C2", "float", tell("epochs", "0", value=2.0)),
    ("C2", "float", tell("epochs", "2", value=1)),
    ("C3", "float", become("0.weights", "f8")),
    ("C3", "float", lambda header, held: held.pop("a.0.theta.npy")),
    ("C3", "float", lambda header, held: held.update({"a.2.theta.npy": held["a.0.theta.npy"]})),
    ("C4", "float", put("0.weights", (0, 0), np.nan)),
    ("C4", "integer", put("1.theta", 0, 0)),
    ("C4", "paper", put("0.delays", (0, 0), 102)),
    ("C4", "paper", put("0.responses", (0, 0), 601)),
]


@pytest.mark.parametrize(
    ("rule", "name", "change"), CHECKPOINTS, ids=[f"{rule}-{k}" for k, (rule, _, _) in enumerate(CHECKPOINTS)]
)
def test_checkpoints(honest: Corpus, rule: str, name: str, change: Change) -> None:
    told = readers.training(honest, name)
    assert checkpoints.check_checkpoint(honest.checkpoints[name], told) == []
    assert found(checkpoints.check_checkpoint(altered(honest.checkpoints[name], change), told), rule)


CORE = "cores/chip0-core000/"
STRETCH = "learning/stretch000/"


def array(name: str, at: Any, value: Any) -> Callable[[bundles.Files], bundles.Files]:
    """Another number in a file of a bundle, sealed."""

    def change(files: bundles.Files) -> bundles.Files:
        held = np.array(arrays.read(files[name]))
        held[at] = value
        return bundles.sealed(files | {name: arrays.stored(held)})

    return change


def value(name: str, *keys: Any, to: Any) -> Callable[[bundles.Files], bundles.Files]:
    """Another value in a JSON file of a bundle, sealed."""

    def change(files: bundles.Files) -> bundles.Files:
        whole = json.loads(files[name])
        tell(*keys, value=to)(whole, {})
        if name == bundles.MANIFEST:
            return bundles.sealed(files, whole)
        return bundles.sealed(files | {name: json.dumps(whole).encode()})

    return change


def references(change: Change) -> Callable[[bundles.Files], bundles.Files]:
    """Other references, sealed."""
    name = bundles.REFERENCES
    return lambda files: bundles.sealed(files | {name: altered(files[name], change)})


BUNDLES: list[tuple[str, str, Callable[[bundles.Files], bundles.Files]]] = [
    ("B1", "loihi2", lambda files: files | {"manifest.json": files["manifest.json"].replace(b"loihi2", b"loihi3")}),
    ("B1", "loihi2", value("manifest.json", "version", to=True)),
    ("B2", "loihi2", lambda files: files | {"host/rates.npy": files["host/rates.npy"] + b"x"}),
    ("B2", "loihi2", lambda files: bundles.sealed(files | {"back\\slash": b""})),
    ("B3", "loihi2", value("manifest.json", "network", "silent_steps", to=4)),
    ("M7", "loihi2", references(put("labels", 1, 0))),
    ("B4", "loihi2", array("host/labels.npy", 0, 1)),
    ("B4", "loihi2", lambda files: bundles.sealed({n: d for n, d in files.items() if n != "host/rates.npy"})),
    ("B5", "kapoho-bay", value(CORE + "registers.json", "cxProfileCfg", 0, "decayV", to=4096)),
    ("B5", "kapoho-bay", array(CORE + "compartments.npy", (0, 0), 9)),
    ("B5", "kapoho-bay-bias", array(CORE + "compartments.npy", (0, 3), 8)),
    ("B5", "kapoho-bay", array(CORE + "compartments.npy", (0, 2), -4096)),
    ("B6", "kapoho-bay", array(CORE + "axons_in.npy", (0, 0), 1)),
    ("B6", "kapoho-bay", array(CORE + "synapses.npy", 0, 15)),
    ("B7", "kapoho-bay", array("host/exc.npy", (0, 2), 1)),
    ("B7", "kapoho-bay", array(CORE + "axons_out.npy", (0, 3), 4000)),
    ("B7", "kapoho-bay", array("host/injection.npy", (0, 3), 4000)),
    ("B8", "kapoho-bay", array("host/injection.npy", (0, 0), 1)),
    ("B8", "kapoho-bay", array(CORE + "compartments.npy", (0, 2), 1)),
    ("B8", "kapoho-bay", array(CORE + "compartments.npy", (-1, 2), 1)),
    ("B8", "loihi2", array("network/weights.npy", (0, 0), 224)),
    ("B9", "loihi2", value("network/parameters.json", "exc", "vth", to=1)),
    ("B9", "loihi2", value("network/parameters.json", "more", to=1)),
    ("B10", "loihi2-learning", array(STRETCH + "thresholds.npy", 0, 0)),
    ("B10", "loihi2-learning", array(STRETCH + "images.npy", 0, 12)),
    ("B10", "loihi2-learning", value("learning/learning.json", "stretches", 0, "rng_seeds", 0, to=-1)),
    ("B10", "loihi2-learning", value("learning/learning.json", "stretches", 0, "phases", 0, "steps", to=10**9)),
]


@pytest.mark.parametrize(
    ("rule", "name", "change"), BUNDLES, ids=[f"{rule}-{k}" for k, (rule, _, _) in enumerate(BUNDLES)]
)
def test_bundles(honest: Corpus, tmp_path: Path, rule: str, name: str, change: Any) -> None:
    view = readers.view(open_bundle(honest.folder / name))
    assert bundle_rules.check_bundle(honest.folder / name, view) == []
    for file, data in change(honest.bundles[name]).items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(data)
    assert found(bundle_rules.check_bundle(tmp_path, view), rule)


def test_lists(honest: Corpus) -> None:
    folder = honest.folder / "listed"
    folder.mkdir()
    path = folder / "list.csv"
    right = [str(folder / name) for name in lists.PATHS]

    def listed(content: bytes, taken: list[str] = right) -> Findings:
        path.write_bytes(content)
        return list_rules.check_list(path, taken, Findings())

    text = lists.HONEST["list.csv"]
    assert listed(text) == []
    assert found(listed(text, right[1:]), "L1")
    assert found(listed(text, [*right[:-1], str(folder / "none.png")]), "L1")
    assert found(listed(text.replace(b"4,../", b"4,5,../")), "L2")
    assert found(listed(text.replace(b"weather", b"image")), "L2")


def test_truths_and_positions(tmp_path: Path) -> None:
    near = np.zeros((PLACES, PLACES), bool)
    for query, places in enumerate(lists.NEAR):
        near[query, places] = True
    for name in ("truth.txt", "truth.csv", "truth.json", "truth-list.json", "truth-pairs.npy"):
        (tmp_path / name).write_bytes(lists.HONEST[name])
        assert list_rules.check_truth(tmp_path / name, near, Findings()) == []
        assert found(list_rules.check_truth(tmp_path / name, near.T, Findings()), "L3")
    path = tmp_path / "positions.csv"
    path.write_bytes(lists.HONEST["positions.csv"])
    metres = np.array(lists.METRES)
    assert list_rules.check_positions(path, metres, Findings()) == []
    assert found(list_rules.check_positions(path, metres[:-1], Findings()), "L4")
    assert found(list_rules.check_positions(path, metres + np.nan, Findings()), "L4")


def test_every_rule_is_broken_here() -> None:
    broken = {rule for table in (MODELS, SETTINGS_CHANGES, CHECKPOINTS, BUNDLES) for rule, *_ in table}
    elsewhere = {"F1", "L1", "L2", "L3", "L4", "M1"}
    assert broken | elsewhere == set(INVARIANTS)
