"""A model file with a right checksum is held against its format, value by value."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.common.commands import fails
from support.common.small_models import encoded, paper_model, small_config, small_model

from lava_vpr import model
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import InputError, ModelFileError, brief
from lava_vpr.positions.frames import Positions
from lava_vpr.storage import container
from lava_vpr.storage.limits import variable
from lava_vpr.training.loop import train

Header = dict[str, Any]
Arrays = dict[str, np.ndarray]
Forge = Callable[[Header, Arrays], object]
PATH = Path("a.lvpr")


@cache
def sound(kind: str) -> tuple[str, Arrays]:
    """Header, as text, and arrays of a model file, or of what a bundle keeps."""
    made = {
        "paper": paper_model,
        "views": lambda: train([encoded(seed=view) for view in range(3)], small_config(views={"shifts": 3})),
    }
    whole = made.get(kind, small_model)()
    header, arrays = model.content(whole, network=kind != "references")
    return json.dumps(header), arrays


def assembled(kind: str, forge: Forge) -> model.Model:
    text, arrays = sound(kind)
    header, own = json.loads(text), {name: array.copy() for name, array in arrays.items()}
    forge(header, own)
    network = small_model().network if kind == "references" else None
    assert network is None or isinstance(network, FixedNetwork)
    return model.assemble(PATH, header, own, network)


def key(*names: str, value: object) -> Forge:
    """Put ``value`` at a place of the header."""

    def forge(header: Header, arrays: Arrays) -> None:
        inner: Any = header
        for name in names[:-1]:
            inner = inner[name]
        inner[names[-1]] = value

    return forge


def first(name: str, value: object) -> Forge:
    """Put ``value`` in front of an array."""
    return lambda header, arrays: arrays[name].reshape(-1).__setitem__(0, value)


def of_type(name: str, dtype: str) -> Forge:
    return lambda header, arrays: arrays.__setitem__(name, arrays[name].astype(dtype))


def wide_responses(value: int) -> Forge:
    """Responses as older files have them, in 32 bits, the first of them ``value``."""

    def forge(header: Header, arrays: Arrays) -> None:
        arrays["responses"] = arrays["responses"].astype(np.int32)
        arrays["responses"][0, 0] = value

    return forge


def instead(name: str, array: np.ndarray) -> Forge:
    return lambda header, arrays: arrays.__setitem__(name, array)


def without(name: str) -> Forge:
    return lambda header, arrays: (header if name in header else arrays).pop(name)


def located(frame: object, corner: object = (0, 0), dtype: str = "float64") -> Forge:
    """Positions in ``frame``, the first of them at ``corner``."""

    def forge(header: Header, arrays: Arrays) -> None:
        arrays["positions"] = np.full((8, 2), 50, dtype)
        arrays["positions"][0] = corner
        header["frame"] = frame

    return forge


DEEP: list[Any] = []
for _ in range(200):
    DEEP = [DEEP]
STRETCHES = [[0, 4, 0, 4, 0], [4, 4, 4, 4, 0]]
NO_SETTINGS = ("encoder", "network", "learning", "decoder")
FORGED: list[tuple[str, Forge, str]] = [
    # keys
    *(("loihi", without(name), repr(name)) for name in ("version", "config", "stretches", "training", "fixed")),
    *(
        ("loihi", without(name), repr(name))
        for name in ("responses", "activity", "thumbnails", "network.weights", "network.bias")
    ),
    *(("paper", without(name), repr(name)) for name in ("network.delays", "network.theta_mv")),
    ("loihi", key("more", value=1), "the model has an unexpected key 'more' in its header"),
    ("loihi", key("x" * 10**6, value=1), "an unexpected key 'xxxxx"),
    ("paper", key("fixed", value={}), "an unexpected key 'fixed'"),
    ("references", key("fixed", value={}), "an unexpected key 'fixed'"),
    ("loihi", instead("extra", np.zeros(2)), "the model has an unexpected array 'extra'"),
    ("references", instead("network.weights", np.zeros((1568, 8), np.int16)), "an unexpected array 'network.weights'"),
    ("references", instead("network.bias", np.zeros(8, np.int32)), "an unexpected array 'network.bias'"),
    ("loihi", lambda header, arrays: header["fixed"].pop("signed"), "fixed"),
    ("loihi", lambda header, arrays: header["fixed"].pop("regular"), "fixed"),
    # numbers and texts of the header
    *(("loihi", key("version", value=v), "version") for v in (5, "", "x" * 50, "\x1b[31m", None, [1])),
    *(("loihi", key("route_images", value=v), "route_images") for v in (7, -1, 8.0, "8", True, None, 10**400)),
    *(("loihi", key("place_names", value=v), "place_names") for v in (5, [], ["a"], {"a": 1}, "abcdefgh", None)),
    ("loihi", key("place_names", value=["a"] * 7), "stretch 1"),
    *(
        ("loihi", key("place_names", value=[v, *"bcdefgh"]), "of place 0")
        for v in ("a\0b", "\ud800", 5, None, "x" * 1025, DEEP)
    ),
    *(("loihi", key("training", value=v), "training") for v in (5, {}, {"spikes_per_image": 1}, DEEP)),
    *(("loihi", key("training", "neurons_used", value=v), "neurons_used") for v in ("1", -1, True, 1e999, None)),
    *(
        ("loihi", key("stretches", value=v), "stretch")
        for v in (
            5,
            [],
            [[0, 99999, -5, 12, 0]],
            [[0, 8, 0, 8.0, 0]],
            [[0, 8, 0]],
            [[0, 8, 0, 0, 0]],
            [[0, 8, 0, True, 0]],
            STRETCHES[:1],
            STRETCHES[::-1],
            [*STRETCHES, [8, 1, 8, 1, 0]],
            [*STRETCHES, [0, 8, 8, 8, 1]],
            [[*STRETCHES[0][:4], 1], STRETCHES[1]],
            [row[:4] for row in STRETCHES],
            [[0, 4, 0, 4, 0], [4, 4, 3, 5, 0]],
            DEEP,
        )
    ),
    ("paper", key("stretches", value=[[0, 4, 0, 6, 0], [4, 4, 6, 6, 0]]), "which learns in one"),
    ("loihi", key("stretches", value=[[0, 4, 0, 3, 0], [4, 4, 3, 5, 0]]), "with 3, which must be in 4..4"),
    ("loihi", key("stretches", value=[[0, 4, 0, 3, 0, 0], [4, 4, 3, 5, 0, 1]]), "with 0, which must be in 1.."),
    ("loihi", key("stretches", value=[[0, 4, 0, 6, 0, 1], [4, 4, 6, 2, 0, 3]]), "with 6, which must be in 0..5"),
    ("loihi", key("stretches", value=[[0, 4, 0, 4, 0, 1, 1], [4, 4, 4, 4, 0]]), "stretch [0, 4, 0, 4"),
    ("loihi", key("stretches", value=[[0, 8, 0, 0, 0, 1]]), "stretches that have no neuron left"),
    ("paper", key("stretches", value=[[0, 8, 0, 12, 0, 1]]), "stretch [0, 8, 0, 12"),
    ("views", lambda header, arrays: header["stretches"][3].__setitem__(4, 0), "stretch"),
    ("views", lambda header, arrays: header["stretches"].pop(), "stretches of"),
    ("views", lambda header, arrays: header["stretches"][0].append(1), "stretch"),
    ("views", lambda header, arrays: arrays["labels"].__setitem__(7, 0), "labels that are not the places"),
    # settings
    *(("loihi", key("config", value=v), "the settings must be a table") for v in (5, [1], None, "loihi")),
    *(("loihi", key("config", "preset", value=v), "preset") for v in (5, [], "x" * 10**6)),
    *(("loihi", key("config", "seed", value=v), "seed") for v in (10**400, -1, 1.0, True, DEEP)),
    *(("loihi", key("config", name, value=5), "must be a table") for name in NO_SETTINGS),
    *(("loihi", key("config", "network", "steps", value=v), "steps") for v in (10**9, 10**400, 0, "9", True, 9.5)),
    *(("loihi", key("config", "network", "threshold", value=v), "threshold") for v in (10**400, 1e999, DEEP, None)),
    *(("loihi", key("config", "network", "input_mode", value=v), "input_mode") for v in (5, [], {}, "x" * 10**6)),
    *(("loihi", key("config", "encoder", "kind", value=v), "kind") for v in (5, [], {})),
    ("loihi", key("config", "network", "\x1b" * 10**6, value=1), "is not a setting"),
    ("loihi", key("config", "network", "weight_bits", value=4), "bits 3 where the settings say 4"),
    ("loihi", key("config", "network", "input_mode", value="bias"), "bias_input 0 where the settings say 1"),
    ("loihi", key("config", "network", "trains", value="poisson"), "regular 1 where the settings say 0"),
    ("loihi", key("config", "network", "signed", value=False), "signed 1 where the settings say 0"),
    *(("loihi", key("config", "network", "signed", value=v), "network.signed") for v in (0, 1, "true", None)),
    ("loihi", key("config", "network", "steps", value=32), "presentations of steps 128 where the settings say 32"),
    ("references", key("config", "network", "steps", value=32), "presentations of steps 128 where the settings say 32"),
    ("loihi", key("config", "network", "steps", value=61), "network.steps is 61, but must be a power of two"),
    # the integer network
    *(("loihi", key("fixed", value=v), "fixed") for v in (5, {}, [], {"bits": 3}, DEEP)),
    *(("loihi", key("fixed", "inhibition", value=v), "inhibition") for v in (0.5, "5", True, None, 256, -1, 10**400)),
    *(("loihi", key("fixed", "steps", value=v), "steps") for v in (10**9, 60, 0, 61.0)),
    *(
        ("loihi", key("fixed", name, value=v), f"{name} {v}")
        for name in ("signed", "regular", "bias_input")
        for v in (2, -1)
    ),
    *(
        ("loihi", key("fixed", name, value=True), f"{name} True")
        for name in ("signed", "regular", "bias_input", "bits")
    ),
    ("loihi", key("fixed", "signed", value=0), "has a sign"),
    ("loihi", key("fixed", "regular", value=0), "regular 0 where the settings say 1"),
    ("loihi", key("fixed", "bias_input", value=1), "bias_input 1 where the settings say 0"),
    *(("loihi", key("fixed", "threshold", value=v), "threshold") for v in (0, 1 << 17, 5.0, None)),
    *(("loihi", key("fixed", "decay", value=v), "decay") for v in (-1, 4097)),
    *(("loihi", key("fixed", "inhibition_exponent", value=v), "inhibition_exponent") for v in (-1, 8, 10**400)),
    *(("loihi", key("fixed", "bits", value=v), "weights need") for v in (0, 8)),
    ("loihi", key("fixed", "more", value=2), "fixed"),
    *(("loihi", first("network.weights", v), "weights need 3 bits") for v in (8, -8)),
    *(("loihi", first("network.weights", v), "network.weights with values") for v in (256, -32_768)),
    *(("loihi", first("network.bias", v), "biases up to") for v in (-(2**31), 2**31 - 1, 4095 << 8, 4097)),
    ("loihi", first("network.bias", 4095), "a bias of 4095 makes its neuron spike without input"),
    ("loihi", of_type("network.bias", "int64"), "network.bias of type int64"),
    ("loihi", instead("network.bias", np.zeros(7, np.int32)), "network.bias of shape (7,)"),
    ("loihi", of_type("network.weights", "uint8"), "network.weights of type uint8"),
    ("loihi", of_type("network.weights", "int64"), "network.weights of type int64"),
    # the conductance network
    *(("paper", first("network.weights", v), "network.weights with values") for v in (np.nan, np.inf, -1e-9, 1e3)),
    *(("paper", first("network.theta_mv", v), "network.theta_mv with values") for v in (np.nan, -1.0, 1e300)),
    ("paper", of_type("network.delays", "int16"), "network.delays of type int16"),
    ("paper", first("network.delays", 101), "network.delays with values"),
    ("paper", instead("network.delays", np.zeros((784, 11), np.uint16)), "network.delays of shape (784, 11)"),
    ("paper", instead("network.theta_mv", np.zeros(11)), "network.theta_mv of shape (11,)"),
    ("paper", instead("learned", np.zeros((784, 12), np.float32)), "learned of shape"),
    ("paper", first("activity", 255.5), "activity with values"),
    # the other arrays
    *(("loihi", first("activity", v), "activity with values") for v in (np.nan, np.inf, -1)),
    *(("loihi", first("learned", v), "learned with values") for v in (np.nan, np.inf, -1)),
    ("loihi", first("responses", 129), "responses with values"),
    *(("loihi", wide_responses(v), "responses with values") for v in (-1, 129)),
    ("loihi", instead("place_indices", np.zeros(8, np.int64)), "place_indices of which two are equal"),
    ("loihi", first("place_indices", -1), "place_indices with values"),
    ("loihi", instead("labels", np.zeros(8, np.int64)), "labels that are not the places"),
    ("loihi", instead("labels", np.arange(8)[::-1].copy()), "labels that are not the places"),
    ("loihi", instead("labels", np.zeros((0,), np.int64)), "labels of shape (0,)"),
    ("loihi", instead("labels", np.array(3)), "labels of shape ()"),
    ("loihi", without("labels"), "'labels'"),
    ("loihi", instead("patches", np.zeros((8, 28, 27), np.uint8)), "patches of shape"),
    ("loihi", instead("hog", np.zeros((8, 1763), np.uint8)), "hog of shape (8, 1763)"),
    ("references", instead("hog", np.zeros((7, 1764), np.uint8)), "hog of shape (7, 1764)"),
    ("paper", of_type("hog", "float32"), "hog of type float32"),
    *(("loihi", located(frame), "frame") for frame in ("", "XY", "UTM 0N", "UTM 61S", "UTM 32", None, 5, DEEP)),
    *(("loihi", located("latlon", at), "out of the range") for at in ((90.1, 0), (0, 361))),
    *(("references", located("xy", (0, v)), "positions with values") for v in (np.nan, np.inf, 1e16)),
    ("loihi", located("xy", dtype="float32"), "positions of type float32"),
    ("loihi", lambda header, arrays: located("xy")(header, arrays) or header.pop("frame"), "positions without a frame"),
    ("paper", key("frame", value="xy"), "a frame without positions"),
    ("loihi", instead("thumbnails", np.zeros((7, 48, 64, 3), np.uint8)), "thumbnails of shape"),
    ("references", instead("learned", np.zeros((1568, 8), np.float32)), "learned of shape"),
    ("references", instead("responses", np.zeros((7, 8), np.int32)), "responses of shape"),
    *(("loihi", of_type(name, "float64"), f"{name} of type") for name in ("learned", "responses", "labels")),
    *(("loihi", of_type(name, "int8"), f"{name} of type") for name in ("activity", "place_indices", "patches")),
]


@pytest.mark.parametrize(
    ("kind", "forge", "cause"), FORGED, ids=[f"{number}-{row[2][:40]}" for number, row in enumerate(FORGED)]
)
def test_what_no_training_writes_is_refused(kind: str, forge: Forge, cause: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        assembled(kind, forge)
    message = str(caught.value)
    assert message.startswith(
        ("a.lvpr: the model has no valid ", "a.lvpr: the model has ", "a.lvpr: the model cannot be used (")
    )
    assert cause in message
    remedy = "deploy the model again" if kind == "references" else "train it again or fetch an intact copy"
    assert message.endswith(remedy)
    assert message.isprintable()
    assert len(message) < 700


@pytest.mark.parametrize("kind", ["loihi", "paper", "references"])
def test_what_training_writes_is_taken(kind: str) -> None:
    assert assembled(kind, lambda header, arrays: None).places == 8


def test_what_a_query_costs_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, amount in (("presentation_operations", 128 * 8 * 21), ("presentation_bytes", 4 * 128 * 20 + 40 * 1576)):
        monkeypatch.setenv(variable(name), str(amount))
        assert assembled("loihi", lambda header, arrays: None).places == 8
        monkeypatch.setenv(variable(name), str(amount - 1))
        with pytest.raises(ModelFileError, match=f"a query takes {amount:,} .*set {variable(name)}, or lower network"):
            assembled("loihi", lambda header, arrays: None)
        monkeypatch.delenv(variable(name))


COMMANDS = {
    "steps": key("fixed", "steps", value=10**9),
    "indices": lambda header, arrays: arrays["place_indices"].fill(3),
    "NaN": first("activity", np.nan),
    "stretches": key("stretches", value=[[0, 99999, -5, 12, 0]]),
    "names": key("place_names", value=5),
    "config": key("config", value=[1]),
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("change", COMMANDS)
def test_commands_refuse_it_in_one_line(change: str, here: Path) -> None:
    header, arrays = container.load(Path("m.lvpr"), "model")
    COMMANDS[change](header, arrays)
    container.save(Path("forged.lvpr"), "model", header, arrays)
    assert fails("query", "forged.lvpr", "query", "-o", "q.csv").startswith("forged.lvpr: the model ")
    assert not Path("q.csv").exists()


@pytest.mark.parametrize("kind", ["loihi", "paper", "references"])
def test_a_file_of_before_hog_is_read(kind: str) -> None:
    assert assembled(kind, without("hog")).hog is None
    assert assembled(kind, lambda header, arrays: None).hog is not None


@pytest.mark.parametrize("kind", ["loihi", "paper", "references"])
def test_positions_are_kept_if_there_are_any(kind: str) -> None:
    assert assembled(kind, lambda header, arrays: None).whereabouts is None
    for frame, corner in (("latlon", (-90, 360)), ("xy", (-1e15, 1e15)), ("UTM 60S", (5e5, 6.5e6))):
        kept = assembled(kind, located(frame, corner)).whereabouts
        assert kept is not None
        assert kept.frame == frame
        assert kept.values.tolist() == [list(corner), *[[50, 50]] * 7]


def test_a_training_with_positions_keeps_them(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(size=(8, 2))
    whole = train(
        [encoded()], small_config(learning={"epochs": 1, "steps": 20}), positions=Positions(values, "UTM 32N")
    )
    model.save(whole, tmp_path / "m.lvpr")
    again = model.load(tmp_path / "m.lvpr")
    assert again.frame == "UTM 32N"
    np.testing.assert_array_equal(again.positions, values)
    with pytest.raises(InputError, match="there are 7 positions for 8 places; give one for each"):
        train([encoded()], small_config(), positions=Positions(values[:7], "xy"))


@pytest.mark.parametrize("kind", ["loihi", "paper", "references"])
def test_responses_in_32_bits_are_read_as_those_in_16(kind: str) -> None:
    """Older files have them so, and those of counts beyond 65,535 need it."""
    plain = assembled(kind, lambda header, arrays: None)
    found = assembled(kind, of_type("responses", "int32"))
    assert found.responses.dtype == plain.responses.dtype == np.uint16
    np.testing.assert_array_equal(found.responses, plain.responses)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.int64(9), "9"),
        (np.float32(0.5), "0.5"),
        ([np.uint8(1), np.bool_(True)], "[1, True]"),
        ({"a": np.float64("nan")}, "{'a': nan}"),
        (np.str_("a\n"), r"'a\n'"),
        (np.array(3), "3"),
        (1 << 200, "a number of 201 bits"),
        ("a" * 90, "'" + "a" * 27 + "..." + "a" * 28 + "'"),
    ],
)
def test_shown_alike_by_every_numpy(value: object, text: str) -> None:
    assert brief(value) == text


def test_what_is_no_python_number_ends() -> None:
    assert "1" in brief(np.longdouble(1))
