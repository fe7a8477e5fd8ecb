"""The model file: whole, or refused with one clear line."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest
from support.common.small_models import encoded, small_model, tiny_paper

from lava_vpr import model
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ModelFileError
from lava_vpr.exchange.nir_writing import container_of
from lava_vpr.model import integer_model
from lava_vpr.recognition import count_query_spikes
from lava_vpr.storage import container
from lava_vpr.training.loop import train


def equal(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    return bool(a == b)


@pytest.mark.parametrize("kind", ["loihi", "paper"])
def test_what_is_saved_is_what_is_loaded(kind: str, tmp_path: Path) -> None:
    if kind == "loihi":
        saved, queries = small_model(), encoded(noise=0.3)
    else:
        saved, queries = train([encoded(inputs=784)], tiny_paper()), encoded(inputs=784, noise=0.3)
    path = tmp_path / "a.lvpr"
    model.save(saved, path)
    loaded = model.load(path)
    for field in dataclasses.fields(saved):
        if field.name != "network":
            assert equal(getattr(saved, field.name), getattr(loaded, field.name)), field.name
    network = FixedNetwork if kind == "loihi" else ConductanceState
    for field in dataclasses.fields(network):
        assert equal(getattr(saved.network, field.name), getattr(loaded.network, field.name)), field.name
    before, events = count_query_spikes(saved, queries)
    after, events_after = count_query_spikes(loaded, queries)
    assert before.any()
    assert np.array_equal(before, after)
    assert events == events_after


def test_equal_models_are_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        model.save(small_model(), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


UNFIT: dict[str, tuple[dict[str, object], str]] = {
    "positions": ({"positions": np.full((8, 2), np.nan), "frame": "xy"}, "positions with values that are not finite"),
    "type": ({"positions": np.zeros((8, 2), np.int64), "frame": "xy"}, "positions of type int64 instead of float64"),
    "frame": ({"positions": np.zeros((8, 2)), "frame": "nope"}, "frame 'nope', which must be xy"),
    "names": ({"place_names": ("a\0", *"bcdefgh")}, "the name 'a.x00' of place 0"),
    "figure": ({"training": {"spikes_per_image": np.nan}}, "training {'spikes_per_image': nan}"),
    "route": ({"route_images": np.int64(9)}, "route_images 9, which must be a whole number"),
    "calibration": ({"calibration": np.full((3, 2), np.nan, np.float32)}, "a calibration with a negative margin"),
    "thumbnails": ({"thumbnails": np.zeros((8, 4, 4, 3), np.uint8)}, "thumbnails of shape"),
}


@pytest.mark.parametrize("case", UNFIT)
def test_what_could_not_be_loaded_is_not_saved(case: str, tmp_path: Path) -> None:
    changes, message = UNFIT[case]
    path, good = tmp_path / "a.lvpr", small_model()
    model.save(good, path)
    before = path.read_bytes()
    bad = dataclasses.replace(good, **changes)
    with pytest.raises(ModelFileError, match=f"a.lvpr: the model cannot be kept, .*{message}.*; correct what it"):
        model.save(bad, path)
    assert path.read_bytes() == before
    for kept in (lambda model: deploy(model, KAPOHO_BAY, tmp_path / "bundle"), container_of):
        with pytest.raises(ModelFileError, match=f"^the model cannot be kept, .*{message}"):
            kept(integer_model(bad, "keeping"))
    assert [made.name for made in tmp_path.iterdir()] == ["a.lvpr"]


def _rewrite(path: Path, change: str) -> None:
    """Damage what is inside, with a checksum that fits."""
    header, arrays = container.load(path, "model")
    if change == "array missing":
        del arrays["responses"]
    elif change == "array shape":
        arrays["responses"] = arrays["responses"][:, :3]
    elif change == "settings":
        header["config"]["network"]["weight_bits"] = 77
    elif change == "fewer inputs":
        arrays["network.weights"] = arrays["network.weights"][:100]
    elif change == "labels":
        arrays["labels"] = arrays["labels"] + 1
    elif change == "decay":
        header["fixed"]["decay"] = -1
    elif change == "bias":
        arrays["network.bias"][0] = 4095
    elif change == "lowest bias":
        arrays["network.bias"][0] = -(2**31)
    elif change == "weights":
        arrays["network.weights"] = np.full_like(arrays["network.weights"], 255)
    container.save(path, "model", header, arrays)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("missing", r"cannot be read \(No such file or directory\)"),
        ("folder", r"cannot be read \(Is a directory\)"),
        ("empty", r"file is empty, not a lava-vpr model"),
        ("foreign", r"is not a lava-vpr model \(made by another program\?\)"),
        ("truncated", r"is damaged \(checksum differs\); train it again"),
        ("flipped", r"is damaged \(checksum differs\)"),
        ("header only", r"is damaged \(checksum differs\)"),
        ("not an archive", r"does not hold what it should"),
        ("newer", r"is a 'lava-vpr model 2' file"),
        ("checkpoint", r"is a 'lava-vpr checkpoint 1' file, not a 'lava-vpr model 1'"),
        ("array missing", r"lacks or garbles 'responses'"),
        ("array shape", r"responses of shape \(8, 3\) instead of \(8, 8\)"),
        ("settings", r"cannot be used \(network\.weight_bits is 77"),
        ("fewer inputs", r"garbles network\.weights of shape \(100, 8\) instead of \(1568, 8\)"),
        ("labels", r"garbles labels with values from 1 to 8, which must be in 0\.\.7"),
        ("decay", r"decay -1 does not fit 0\.\.4096"),
        ("weights", r"cannot be used \(weights need 3 bits to hold 255"),
        ("bias", r"cannot be used \(a bias of 4095 makes its neuron spike without input"),
        ("lowest bias", r"cannot be used \(biases up to 2147483648 fit no 12 bits"),
    ],
)
def test_damage_is_told_in_one_line(damage: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "a.lvpr"
    model.save(small_model(), path)
    data = path.read_bytes()
    payload = b"not a zip"
    magic = b"lava-vpr model 1\n"
    contents = {
        "empty": b"",
        "foreign": b"PK\x03\x04 something else",
        "truncated": data[:-100],
        "flipped": data[:5000] + bytes([data[5000] ^ 1]) + data[5001:],
        "header only": magic,
        "not an archive": magic + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload,
        "newer": data.replace(b"model 1", b"model 2", 1),
        "checkpoint": data.replace(b"model 1", b"checkpoint 1", 1),
    }
    if damage in contents:
        path.write_bytes(contents[damage])
    elif damage == "missing":
        path.unlink()
    elif damage == "folder":
        path.unlink()
        path.mkdir()
    else:
        _rewrite(path, damage)
    with pytest.raises(ModelFileError, match=message) as caught:
        model.load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("byte", range(0, 90, 7))
def test_any_flipped_byte_of_the_start_is_noticed(byte: int, tmp_path: Path) -> None:
    path = tmp_path / "a"
    model.save(small_model(), path)
    data = bytearray(path.read_bytes())
    data[byte] ^= 0x20
    path.write_bytes(bytes(data))
    with pytest.raises(ModelFileError):
        model.load(path)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.lvpr"
    model.save(small_model(), path)
    before = path.read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ModelFileError, match=r"cannot be written \(No space left on device\); free space"):
        model.save(small_model(), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.lvpr"]


def test_a_missing_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="cannot be written"):
        model.save(small_model(), tmp_path / "no" / "a.lvpr")


def test_the_header_is_plain_json(tmp_path: Path) -> None:
    path = tmp_path / "a"
    model.save(small_model(), path)
    header, _ = container.load(path, "model")
    assert json.loads(json.dumps(header)) == header
    assert header["config"]["preset"] == "loihi"
