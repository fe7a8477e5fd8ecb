"""Bundles by an enemy who makes the checksums right: one line that names file, cause and remedy."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from support.common.small_models import small_model

from lava_vpr.backends.deployed import bundle_of
from lava_vpr.cli import main
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle import loihi2
from lava_vpr.deploy.bundle.deployment import contents, deploy
from lava_vpr.deploy.bundle.folder import MANIFEST, ReadBundle, array_bytes, json_bytes, sealed
from lava_vpr.deploy.bundle.targets import open_bundle
from lava_vpr.errors import BundleError, ModelFileError

Told, Files = dict[str, Any], dict[str, bytes]


@pytest.fixture(scope="module")
def sound() -> dict[str, tuple[Told, Files]]:
    """Manifest and files of a bundle for each board, that for Loihi 2 with learning; programs are left out."""
    found = {}
    for board in BOARDS.values():
        told, files, _ = contents(small_model(), board, learning=board.name == "loihi2", picture=False)
        found[board.name] = told, {name: data for name, data in files.items() if not name.startswith("program/")}
    return found


def put(path: Path, told: Mapping[str, Any], files: Files) -> Path:
    """A bundle whose checksums are right."""
    for name, data in (*files.items(), (MANIFEST, json_bytes(sealed(told, files)))):
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)
    return path


CORE = "cores/chip0-core000"


def number(name: str, value: Any) -> Callable[[Told, Files], None]:
    """Another number of the network in the manifest."""

    def change(told: Told, files: Files) -> None:
        told["network"][name] = value

    return change


def array(name: str, change: Callable[[NDArray[Any]], Any]) -> Callable[[Told, Files], None]:
    """Another array: ``change`` returns it, or alters the one that it is given."""

    def changed(told: Told, files: Files) -> None:
        before = ReadBundle(Path(), {}, files).array(name)
        after = change(before)
        files[name] = array_bytes(before if after is None else after)

    return changed


def at(*where: Any) -> Callable[[NDArray[Any]], None]:
    """Put the last of ``where`` at the index before."""

    def change(found: NDArray[Any]) -> None:
        found[tuple(where[:-1])] = where[-1]

    return change


def values(name: str, *where: Any) -> Callable[[Told, Files], None]:
    """Another value in a JSON file: the last of ``where``, at the keys before."""

    def change(told: Told, files: Files) -> None:
        whole = json.loads(files[name])
        inner = whole
        for key in where[:-2]:
            inner = inner[key]
        inner[where[-2]] = where[-1]
        files[name] = json.dumps(whole).encode()

    return change


def text(name: str, data: bytes) -> Callable[[Told, Files], None]:
    """Another content of a file."""
    return lambda told, files: files.__setitem__(name, data)


REGISTERS, PARAMETERS, LEARNING = f"{CORE}/registers.json", loihi2.PARAMETERS, "learning/learning.json"
STRETCH = "learning/stretch000"
PHASE = ("stretches", 0, "phases", 0)
KAPOHO: dict[str, tuple[Callable[[Told, Files], Any], str, str]] = {
    "steps of 10^9": (number("steps", 10**9), MANIFEST, "steps 1000000000, of 1..100000"),
    "a long number": (number("bits", 10**4000), MANIFEST, "is no JSON (a number of 4,001 digits is too long)"),
    "true steps": (number("steps", True), MANIFEST, "steps True, of"),
    "silent steps": (number("silent_steps", 4), MANIFEST, "says silent_steps 4, but its network has 3"),
    "inputs beyond memory": (number("inputs", 2**31 - 1), MANIFEST, "weights take 34,359,738,352 bytes, more than"),
    "half a sign": (number("signed", 2), MANIFEST, "signed 2, of 0..1"),
    "no sign": (number("signed", 0), "cores", "deploy the model again"),
    "inputs of another kind": (
        number("bias_input", 1),
        "host/inputs.npy",
        "is int32 (0, 3), but must be int32 (1568, 3)",
    ),
    "other inputs": (
        number("inputs", 7),
        MANIFEST,
        "says inputs 7, but the settings in host/references.lvpr make 1568",
    ),
    "another threshold": (number("threshold", 9999), REGISTERS, "contradicts the rest"),
    "another decay": (number("decay", 4000), REGISTERS, "contradicts the rest"),
    "other inhibition": (number("inhibition", 3), REGISTERS, "contradicts the rest"),
    "fewer bits": (number("bits", 1), "cores", "hold no network of ours (weights need"),
    "a counter elsewhere": (array("host/counters.npy", at(0, 2, -1)), "cores", "do not name each of its compartments"),
    "other neurons": (number("neurons", 9), "host/exc.npy", "is int32 (8, 3), but must be int32 (9, 3)"),
    "other places": (number("places", 3), MANIFEST, "says places 3, but holds 8"),
    "no network": (lambda told, files: told.update(network=[]), MANIFEST, "does not describe the network"),
    "host spikes": (lambda told, files: told["limits"].update(host_spikes=99), MANIFEST, "host_spikes 99, of 0..56"),
    "no limits": (lambda told, files: told.pop("limits"), MANIFEST, "has host_spikes None, of 0..56"),
    "a core of no chip": (
        lambda told, files: [
            files.__setitem__(name.replace(CORE, "cores/chip7-core000"), files.pop(name))
            for name in [name for name in files if name.startswith(CORE)]
        ],
        "cores/chip7-core000",
        "is no core of Kapoho Bay",
    ),
    "a core twice": (text("cores/chip0-core0/registers.json", b"{}"), "cores/chip0-core0", "is no core of Kapoho Bay"),
    "a file beside a core's": (text(f"{CORE}/more.npy", b""), CORE, "is no core of Kapoho Bay"),
    "many compartments": (
        array(f"{CORE}/compartments.npy", lambda a: np.zeros((1025, 4), np.int32)),
        "cores",
        "chip 0 core 0: the host's tables do not name each of its compartments once",
    ),
    "a bias beyond its register": (
        array(f"{CORE}/compartments.npy", at(0, 2, 4096)),
        "cores",
        "chip 0 core 0: a bias does not fit its register",
    ),
    "an exponent beyond its register": (array(f"{CORE}/compartments.npy", at(0, 3, 8)), "cores", "a bias does not fit"),
    "a bias below its register": (array(f"{CORE}/compartments.npy", at(0, 2, -4096)), "cores", "a bias does not fit"),
    "an exponent below 0": (array(f"{CORE}/compartments.npy", at(0, 3, -1)), "cores", "a bias does not fit"),
    "a long exponent": (array(f"{CORE}/compartments.npy", at(0, 3, 1 << 30)), "cores", "a bias does not fit"),
    "a neuron that needs no input": (array(f"{CORE}/compartments.npy", at(0, 2, 4095)), "cores", "spike without input"),
    "memory of nobody": (array(f"{CORE}/axons_in.npy", at(0, 0, -5)), "cores", "do not tile its memory"),
    "memory of two rows": (array(f"{CORE}/axons_in.npy", at(0, 0, 1)), "cores", "do not tile its memory"),
    "a row without end": (array(f"{CORE}/axons_in.npy", at(0, 2, 2**31 - 1)), "cores", "deploy the model again"),
    "a compartment below": (array("host/exc.npy", at(0, 2, -1)), "cores", "do not name each of its compartments"),
    "a compartment above": (array("host/inh.npy", at(0, 2, 4000)), "cores", "do not name each of its compartments"),
    "two in one place": (
        array("host/exc.npy", lambda a: a[[1, 1, *range(2, len(a))]]),
        "cores",
        "do not name each of its compartments once",
    ),
    "an input of nobody": (
        array("host/injection.npy", at(0, 0, 1568)),
        "cores",
        "hold no network of ours (index 1568 is out of bounds",
    ),
    "injected nowhere": (array("host/injection.npy", at(0, 3, -1)), f"{CORE}/synapses.npy", "but must be uint64 (27"),
    "no weight bits": (values(REGISTERS, "synapseFmt", 1, "wgtBits", 0), "cores", "no synapse format of ours"),
    "17 formats": (values(REGISTERS, "synapseFmt", [None] * 17), "cores", "deploy the model again"),
    "more memory than a core's": (
        array(f"{CORE}/synapses.npy", lambda a: np.zeros(16385, np.uint64)),
        "cores",
        "do not tile its memory",
    ),
    "more axons than a core's": (
        array(f"{CORE}/axons_in.npy", lambda a: np.zeros((4097, 3), np.int32)),
        "cores",
        "do not tile its memory",
    ),
    "registers of lists": (values(REGISTERS, "synapseFmt", 1, "fanoutType", []), "cores", "no synapse format of ours"),
    "an endless exponent": (
        text(REGISTERS, b'{"synapseFmt": [{"wgtBits": 1, "idxBits": 0, "wgtExp": 1e999}]}'),
        "cores",
        "",
    ),
    "deep registers": (text(REGISTERS, b"[" * 100_000), REGISTERS, "is no JSON (it is nested too deeply)"),
    "registers that are none": (text(REGISTERS, b"7"), "cores", "hold no network of ours"),
    "no labels": (lambda told, files: files.pop("host/labels.npy"), "host/labels.npy", "the bundle lacks this file"),
    "injected too far": (array("host/injection.npy", at(0, 3, 4000)), "cores", "deploy the model again"),
    "other synapses": (array(f"{CORE}/synapses.npy", at(0, 15)), "cores", "deploy the model again"),
    "learning": (text(LEARNING, b"{}"), LEARNING, "is for a board that does not learn"),
}
KAPOHO |= {
    kind: (array(name, change), name, said)
    for kind, name, change, said in (
        ("floats", f"{CORE}/compartments.npy", lambda a: a.astype(float), "is float64"),
        ("one axis", f"{CORE}/axons_in.npy", lambda a: a.ravel(), "but must be int32 (axons, 3)"),
        ("a source of nobody", f"{CORE}/axons_out.npy", at(0, 0, -1), "contradicts the rest"),
        ("a core of nobody", f"{CORE}/axons_out.npy", at(0, 2, 99), "contradicts the rest"),
        ("an axon of nobody", f"{CORE}/axons_out.npy", at(0, 3, 2**31 - 1), "contradicts the rest"),
        (
            "axons that change places",
            f"{CORE}/axons_in.npy",
            lambda a: a[[*range(len(a) - 2), -1, -2]],
            "contradicts the rest",
        ),
        (
            "a bias of the root",
            f"{CORE}/compartments.npy",
            lambda a: a + (a[:, :1] == 1) * np.array([0, 0, 1, 0], np.int32),
            "contradicts the rest",
        ),
        ("a root of nobody", "host/inh.npy", lambda a: a[:0], "must be int32 (1, 3)"),
        ("a profile of nobody", f"{CORE}/compartments.npy", at(0, 0, 9), "contradicts the rest"),
        ("a threshold of nobody", f"{CORE}/compartments.npy", at(0, 1, -1), "contradicts the rest"),
        ("other keys", "host/keys.npy", at(0, 5), "contradicts the rest"),
        ("fewer keys", "host/keys.npy", lambda a: a[1:], "is uint64 (7,), but must be uint64 (8,)"),
        ("other rates", "host/rates.npy", at(0, 0, 60_000), "are not the rates of the references"),
        ("other labels", "host/labels.npy", at(0, 5), "contradicts the rest of the bundle"),
        ("responses below 0", "host/responses.npy", at(0, 0, -1), "contradicts the rest"),
    )
}
KAPOHO |= {
    kind: (values(REGISTERS, *where), REGISTERS, "contradicts the rest")
    for kind, *where in (
        ("registers of truths", "cxProfileCfg", 0, "enableNoise", False),
        ("a decay of no register", "cxProfileCfg", 0, "decayU", 4096),
        ("a threshold of no register", "vthProfileCfg", 0, "vth", -1),
        ("no refractory step", "cxProfileCfg", 0, "refractDelay", 0),
        ("a floor of no register", "dendriteSharedCfg", "negVmLimit", 24),
        ("a ceiling of no register", "dendriteSharedCfg", "posVmLimit", 8),
        ("a long floor", "dendriteSharedCfg", "negVmLimit", 10**30),
        ("no profiles", "cxProfileCfg", []),
    )
}
KAPOHO["no synapseFmt"] = values(REGISTERS, "synapseFmt", None), "cores", "deploy the model again"
GROUPS = ("cxProfileCfg", "vthProfileCfg", "dendriteSharedCfg", "numUpdates")
KAPOHO |= {f"no {name}": (values(REGISTERS, name, None), REGISTERS, "contradicts the rest") for name in GROUPS}
LOIHI_2: dict[str, tuple[Callable[[Told, Files], Any], str, str]] = {
    "true for 1": (values(PARAMETERS, "exc", "reset_offset", True), PARAMETERS, "contradicts the rest of the bundle"),
    "1.0 for 1": (values(PARAMETERS, "relay", "weight_exp", 0.0), PARAMETERS, "contradicts the rest"),
    "parameters that are none": (text(PARAMETERS, b"[]"), PARAMETERS, "describes no network that Loihi 2 can run"),
    "more parameters": (values(PARAMETERS, "more", 1), PARAMETERS, "deploy the model again"),
    "a long threshold": (
        values(PARAMETERS, "network", "threshold", 10**300),
        PARAMETERS,
        "describes no network that",
    ),
    "no weights": (array(loihi2.WEIGHTS, lambda a: a[:0]), loihi2.WEIGHTS, "is empty, (0, 1568)"),
    "a schedule of other epochs": (
        array(f"{STRETCH}/keys.npy", lambda a: a[1:]),
        f"{STRETCH}/keys.npy",
        "is uint64 (19,), but must be uint64 (20,)",
    ),
    "other rates of learning": (array("learning/rates.npy", at(0, 0, 9)), "learning/rates.npy", "are not the rates"),
    "learning of nothing": (text(LEARNING, b"{}"), LEARNING, "contradicts the rest of the bundle"),
    "a key twice": (text(LEARNING, b'{"seed": 0, "seed": 0}'), LEARNING, "is no JSON (an object says a key twice)"),
}
LOIHI_2 |= {
    f"{where[-2]} of {where[-1]!r:.9}": (values(LEARNING, *where), LEARNING, "contradicts the rest of the bundle")
    for where in (
        ("stretches", 0, "folder", "../x"),
        ("stretches", []),
        ("stretches", 0, "first_place", 4),
        (*PHASE, "epochs", 10**9),
        (*PHASE, "steps", 10**9),
        (*PHASE, "learning_rule", "x1_tau", 10**300),
        (*PHASE, "learning_rule", "x1_impulse", True),
        (*PHASE, "learning_rule", "dw", "2^-1*y0*(x1-1)"),
        ("stretches", 0, "phases", None),
        ("stretches", 0, "rng_seeds", []),
        ("stretches", 0, "rng_seeds", 0, 1e308),
    )
}
LOIHI_2 |= {
    f"{name} {said}": (array(f"{STRETCH}/{name}.npy", change), f"{STRETCH}/{name}.npy", said)
    for name, change, said in (
        ("weights", lambda a: a[1:], "must be uint8 (1568, 4)"),
        ("thresholds", at(0, 0), "contradicts the rest of the bundle"),
        ("images", at(0, -(2**31)), "contradicts the rest of the bundle"),
        ("epochs", at(-1, 99), "contradicts the rest of the bundle"),
    )
}
CASES = {("kapoho-bay", kind): case for kind, case in KAPOHO.items()}
CASES |= {("loihi2", kind): case for kind, case in LOIHI_2.items()}


@pytest.mark.parametrize(("board", "kind"), CASES)
def test_every_part_is_checked(sound: Any, tmp_path: Path, board: str, kind: str) -> None:
    change, file, said = CASES[board, kind]
    told, files = json.loads(json.dumps(sound[board][0])), dict(sound[board][1])
    change(told, files)
    assert (told, files) != sound[board]
    path = put(tmp_path / "b", told, files)
    with pytest.raises(BundleError) as caught:
        open_bundle(path)
    line = str(caught.value)
    assert line.startswith(f"{path / file}: ")
    assert said in line
    assert "; " in line
    assert line.isprintable()
    assert len(line) < 600


def test_trains_that_the_settings_do_not_say_are_refused(sound: Any, tmp_path: Path) -> None:
    """No core knows how the inputs spike; the settings do."""
    told, files = sound["kapoho-bay"]
    path = put(tmp_path / "b", {**told, "network": {**told["network"], "regular": 0}}, files)
    with pytest.raises(ModelFileError, match=r"^\S*references.lvpr: .*regular 0 where the settings say 1; deploy"):
        open_bundle(path)


def test_what_was_not_changed_is_taken(sound: Any, tmp_path: Path) -> None:
    for board, (told, files) in sound.items():
        assert open_bundle(put(tmp_path / board, told, files)).places == 8


@pytest.mark.parametrize(
    ("board", "part", "change"),
    [
        ("kapoho-bay", "bias", array(f"{CORE}/compartments.npy", at(0, 2, 1))),
        ("loihi2", "weights", array(loihi2.WEIGHTS, at(0, 0, 224))),
    ],
)
def test_what_a_board_gets_is_what_is_read(sound: Any, board: str, part: str, change: Any, tmp_path: Path) -> None:
    told, files = sound[board][0], dict(sound[board][1])
    before = open_bundle(put(tmp_path / "a", told, files))
    change(told, files)
    after = open_bundle(put(tmp_path / "b", told, files))
    assert (getattr(before.network, part) != getattr(after.network, part)).sum() == 1


def test_a_bundle_that_is_replaced_meanwhile_is_not_mixed_with_the_first(tmp_path: Path) -> None:
    before = small_model()
    deploy(before, BOARDS["kapoho-bay"], tmp_path / "b", picture=False)
    model = open_bundle(tmp_path / "b")
    other = replace(before, network=replace(before.network, threshold=before.network.threshold + 1))
    deploy(other, BOARDS["kapoho-bay"], tmp_path / "b", picture=False)
    with (
        pytest.raises(BundleError, match="b: was replaced while it was in use; run the command again"),
        bundle_of(model),
    ):
        raise AssertionError


@pytest.mark.parametrize("command", ["eval", "query", "verify"])
def test_a_command_says_one_line(here: Path, sound: Any, command: str) -> None:
    told, files = sound["kapoho-bay"]
    put(Path("b"), {**told, "network": {**told["network"], "steps": 10**9}}, files)
    result = CliRunner().invoke(main, [command, "b", "query", *(("-o", "q.csv") if command == "query" else ())])
    assert result.exit_code == 1
    assert result.stderr == (
        "lava-vpr: error: b/manifest.json: does not describe the network (steps 1000000000, of 1..100000); deploy the "
        "model again or fetch an intact copy\n"
    )


def numbers(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every whole number in JSON: what holds it, and its key there."""
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(inner, (dict, list)):
            yield from numbers(inner)
        elif type(inner) is int:
            yield value, key


@pytest.mark.parametrize("board", BOARDS)
def test_one_more_than_any_number_is_refused(sound: Any, tmp_path: Path, board: str) -> None:
    told, files = sound[board]
    rng = np.random.default_rng(0)
    for name in (MANIFEST, *(name for name in files if name.endswith(".json") and name != "mapping.json")):
        own = name == MANIFEST
        text = json.dumps(told["network"]) if own else files[name]
        count = len(list(numbers(json.loads(text))))
        for k in range(count) if own else rng.choice(count, 15, replace=False):
            whole = json.loads(text)
            inner, key = list(numbers(whole))[k]
            inner[key] += 1
            other = ({**told, "network": whole}, files) if own else (told, files | {name: json_bytes(whole)})
            with pytest.raises(ModelFileError):
                open_bundle(put(tmp_path / "b", *other))
