"""The model file: whole, or refused with one clear line."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.common.small_models import encoded, paper_model, small_model

from lava_vpr import model
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ModelFileError
from lava_vpr.exchange.nir_writing import container_of
from lava_vpr.model import integer_model
from lava_vpr.recognition import count_query_spikes


def equal(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    return bool(a == b)


@pytest.mark.parametrize("kind", ["loihi", "paper"])
def test_what_is_saved_is_what_is_loaded(kind: str, tmp_path: Path) -> None:
    if kind == "loihi":
        saved, queries = small_model(), encoded(noise=0.3)
    else:
        saved, queries = paper_model(), encoded(inputs=784, noise=0.3)
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


def file(make: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    """Damage the file."""
    return lambda path: path.write_bytes(make(path.read_bytes()))


def become_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


MAGIC, PAYLOAD = b"lava-vpr model 1\n", b"not a zip"
DAMAGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (Path.unlink, r"cannot be read \(No such file or directory\)"),
    "folder": (become_folder, r"cannot be read \(Is a directory\)"),
    "empty": (file(lambda data: b""), r"file is empty, not a lava-vpr model"),
    "foreign": (
        file(lambda data: b"PK\x03\x04 something else"),
        r"is not a lava-vpr model \(made by another program\?\)",
    ),
    "truncated": (file(lambda data: data[:-100]), r"is damaged \(checksum differs\); train it again"),
    "flipped": (
        file(lambda data: data[:5000] + bytes([data[5000] ^ 1]) + data[5001:]),
        r"is damaged \(checksum differs\)",
    ),
    "header only": (file(lambda data: MAGIC), r"is damaged \(checksum differs\)"),
    "not an archive": (
        file(lambda data: MAGIC + hashlib.sha256(PAYLOAD).hexdigest().encode() + b"\n" + PAYLOAD),
        r"does not hold what it should",
    ),
    "newer": (file(lambda data: data.replace(b"model 1", b"model 2", 1)), r"is a 'lava-vpr model 2' file"),
    "checkpoint": (
        file(lambda data: data.replace(b"model 1", b"checkpoint 1", 1)),
        r"is a 'lava-vpr checkpoint 1' file, not a 'lava-vpr model 1'",
    ),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_damage_is_told_in_one_line(name: str, tmp_path: Path) -> None:
    path, (damage, message) = tmp_path / "a.lvpr", DAMAGES[name]
    model.save(small_model(), path)
    damage(path)
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
