"""The bundle folder: complete or not at all, byte for byte reproducible, and useless once altered."""

from __future__ import annotations

import errno
import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lava_vpr.deploy.bundle import folder as bundle
from lava_vpr.deploy.bundle.folder import MANIFEST, array_bytes, json_bytes, load, self_digest, write
from lava_vpr.errors import BundleError

FILES = {
    "README.md": b"read me\n",
    "cores/chip0-core000/synapses.npy": array_bytes(np.arange(9, dtype=np.uint64)),
    "cores/chip0-core001/synapses.npy": array_bytes(np.arange(4, dtype=np.uint64)),
    "host/settings.json": json_bytes({"a": 1}),
}
TOLD = {"target": "kapoho-bay", "network": {"inputs": 3}}


@pytest.fixture
def intact(tmp_path: Path) -> Path:
    """A bundle of a few files."""
    write(tmp_path / "bundle", TOLD, FILES)
    return tmp_path / "bundle"


def tree(path: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


def test_what_was_written_is_read(intact: Path) -> None:
    read = load(intact)
    assert read.files == FILES
    assert read.target == "kapoho-bay"
    assert read.manifest["network"] == {"inputs": 3}
    assert read.json("host/settings.json") == {"a": 1}
    assert read.array("cores/chip0-core000/synapses.npy").tolist() == list(range(9))
    assert read.folders("cores") == ("cores/chip0-core000", "cores/chip0-core001")


def test_equal_content_gives_equal_bytes(intact: Path, tmp_path: Path) -> None:
    write(tmp_path / "other", TOLD, dict(reversed(FILES.items())))
    assert tree(intact) == tree(tmp_path / "other")


def reseal(path: Path, **changes: Any) -> None:
    """Alter the manifest and its checksum with it, as a clever forger would."""
    manifest = json.loads((path / MANIFEST).read_bytes()) | changes
    manifest["sha256"] = self_digest(manifest)
    (path / MANIFEST).write_bytes(json_bytes(manifest))


def flip(file: Path) -> None:
    """Change one bit in the middle."""
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


def cut(file: Path) -> None:
    """Lose the last byte."""
    file.write_bytes(file.read_bytes()[:-1])


SYNAPSES = "cores/chip0-core000/synapses.npy"
DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "a bit of memory": (lambda p: flip(p / SYNAPSES), f"{SYNAPSES}: was altered"),
    "a byte lost": (lambda p: cut(p / SYNAPSES), f"{SYNAPSES}: has 199 bytes instead of 200"),
    "a file lost": (lambda p: (p / SYNAPSES).unlink(), f"{SYNAPSES}: is missing from the bundle"),
    "an empty file": (lambda p: (p / SYNAPSES).write_bytes(b""), f"{SYNAPSES}: has 0 bytes"),
    "no manifest": (lambda p: (p / MANIFEST).unlink(), f"holds no {MANIFEST}"),
    "a cut manifest": (lambda p: cut(cut(p / MANIFEST) or p / MANIFEST), f"{MANIFEST}: is no JSON"),
    "a foreign manifest": (lambda p: (p / MANIFEST).write_text("{}"), "is not a bundle's manifest"),
    "an edited manifest": (
        lambda p: (p / MANIFEST).write_text((p / MANIFEST).read_text().replace('"inputs": 3', '"inputs": 4')),
        f"{MANIFEST}: was altered",
    ),
    "a later version": (lambda p: reseal(p, version=2), "is of version 2, this program reads 1"),
    "an unknown board": (lambda p: reseal(p, target="loihi9"), "is for the unknown board 'loihi9'"),
    "a file outside": (
        lambda p: reseal(p, files={"../secret": {"bytes": 1, "sha256": "0"}}),
        "names '../secret', which is not in the bundle",
    ),
    "a folder for a file": (
        lambda p: ((p / "README.md").unlink(), (p / "README.md").mkdir()),
        "README.md: cannot be read (Is a directory)",
    ),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_is_named(intact: Path, kind: str) -> None:
    damage, expected = DAMAGE[kind]
    damage(intact)
    with pytest.raises(BundleError) as caught:
        load(intact)
    text = str(caught.value)
    assert expected in text
    assert "\n" not in text
    assert "; " in text, "the remedy is missing"


def test_every_damage_has_its_own_message(tmp_path: Path) -> None:
    seen = set()
    for number, (damage, _) in enumerate(DAMAGE.values()):
        path = tmp_path / str(number)
        write(path, TOLD, FILES)
        damage(path)
        with pytest.raises(BundleError) as caught:
            load(path)
        seen.add(str(caught.value).removeprefix(str(path)))
    assert len(seen) == len(DAMAGE) >= 12


def test_what_is_no_bundle(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match=r"nowhere: does not exist; give a folder written by `lava-vpr deploy`"):
        load(tmp_path / "nowhere")
    (tmp_path / "file").write_text("x")
    with pytest.raises(BundleError, match="file: is not a bundle, which is a folder"):
        load(tmp_path / "file")


def test_wrong_kinds_of_content(intact: Path) -> None:
    read = load(intact)
    with pytest.raises(BundleError, match=r"README.md: is no array"):
        read.array("README.md")
    with pytest.raises(BundleError, match=r"README.md: is no JSON"):
        read.json("README.md")
    with pytest.raises(BundleError, match=r"absent: the bundle lacks this file"):
        read.data("absent")


def test_a_bundle_is_replaced_in_one_step(intact: Path) -> None:
    write(intact, TOLD, {"only": b"new"})
    assert sorted(tree(intact)) == [MANIFEST, "only"]
    assert [entry.name for entry in intact.parent.iterdir()] == ["bundle"], "something was left beside it"


def test_a_bundle_is_replaced_where_folders_cannot_be_exchanged(intact: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bundle.ctypes, "CDLL", lambda *a, **k: object())  # an old C library
    write(intact, TOLD, {"only": b"new"})
    assert sorted(tree(intact)) == [MANIFEST, "only"]
    assert [entry.name for entry in intact.parent.iterdir()] == ["bundle"]


@pytest.mark.parametrize("stopped", [1, 2, 3])
def test_a_replacement_that_is_interrupted_loses_neither_bundle(
    intact: Path, monkeypatch: pytest.MonkeyPatch, stopped: int
) -> None:
    monkeypatch.setattr(bundle.ctypes, "CDLL", lambda *a, **k: object())
    rename, calls = Path.rename, []

    def slow(self: Path, target: Path) -> Path:
        result = rename(self, target)
        calls.append(target)
        if len(calls) == stopped:
            signal.raise_signal(signal.SIGINT)
        return result

    monkeypatch.setattr(Path, "rename", slow)
    with pytest.raises(KeyboardInterrupt):
        write(intact, TOLD, {"only": b"new"})
    assert sorted(tree(intact)) == [MANIFEST, "only"]
    assert [entry.name for entry in intact.parent.iterdir()] == ["bundle"]


def test_a_damaged_bundle_may_be_replaced(intact: Path) -> None:
    flip(intact / SYNAPSES)
    write(intact, TOLD, FILES)
    assert load(intact).files == FILES


def test_other_folders_are_not_replaced(intact: Path, tmp_path: Path) -> None:
    foreign = tmp_path / "photos"
    foreign.mkdir()
    (foreign / "holiday.jpg").write_bytes(b"x")
    with pytest.raises(BundleError, match="photos: holds something else than a bundle; name another folder"):
        write(foreign, TOLD, FILES)
    (intact / "results.csv").write_text("mine")
    with pytest.raises(BundleError, match=r"holds results.csv, which is no part of the bundle; move it"):
        write(intact, TOLD, FILES)
    assert (intact / "results.csv").read_text() == "mine"
    (tmp_path / "file").write_text("x")
    with pytest.raises(BundleError, match="file: is no folder, and a bundle is one; name another"):
        write(tmp_path / "file", TOLD, FILES)
    with pytest.raises(BundleError, match=r"the folder .*absent does not exist; create it first"):
        write(tmp_path / "absent" / "bundle", TOLD, FILES)


def test_what_python_leaves_behind_does_not_count(intact: Path) -> None:
    (intact / "program" / "__pycache__").mkdir(parents=True)
    (intact / "program" / "__pycache__" / "run.pyc").write_bytes(b"x")
    assert load(intact).files == FILES
    write(intact, TOLD, FILES)


def test_an_empty_folder_may_be_filled(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    write(tmp_path / "empty", TOLD, FILES)
    assert load(tmp_path / "empty").files == FILES


def test_a_full_disk_leaves_what_was_there(intact: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = tree(intact)

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(bundle.os, "fsync", full)
    with pytest.raises(BundleError, match=r"cannot be written \(No space left on device\); free space or choose"):
        write(intact, TOLD, {"only": b"new"})
    assert tree(intact) == before
    assert [entry.name for entry in intact.parent.iterdir()] == ["bundle"]


def test_an_interrupt_leaves_what_was_there(intact: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = tree(intact)

    def stop(handle: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(bundle.os, "fsync", stop)
    with pytest.raises(KeyboardInterrupt):
        write(intact, TOLD, {"only": b"new"})
    assert tree(intact) == before
    assert [entry.name for entry in intact.parent.iterdir()] == ["bundle"]
