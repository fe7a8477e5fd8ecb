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
from lava_vpr.deploy.bundle.folder import (
    MANIFEST,
    ReadBundle,
    array_bytes,
    check_replaceable,
    json_bytes,
    load,
    self_digest,
    write,
)
from lava_vpr.errors import BundleError, brief

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


FORGED: dict[str, tuple[dict[str, Any], str]] = {
    "no list": ({"files": ["README.md"]}, "lists ['README.md'] instead of its files"),
    "no facts": ({"files": {"README.md": 7}}, "says 7 of README.md, not its bytes and sha256"),
    "more facts": ({"files": {"a": {"bytes": 1, "sha256": "0" * 64, "x": 1}}}, "of a, not its bytes and sha256"),
    "bytes in words": ({"files": {"a": {"bytes": "1", "sha256": "0" * 64}}}, "of a, not its bytes and sha256"),
    "true bytes": ({"files": {"a": {"bytes": True, "sha256": "0" * 64}}}, "of a, not its bytes and sha256"),
    "negative bytes": ({"files": {"a": {"bytes": -1, "sha256": "0" * 64}}}, "of a, not its bytes and sha256"),
    "a board that is a list": ({"target": [[]]}, "is for the unknown board [[]]"),
    "a version that is true": ({"version": True}, "is of version True, this program reads 1"),
    "a checksum that is none": ({"sha256": [1]}, "was altered (checksum differs)"),
    "a number beyond all floats": ({"lava_vpr": float("inf")}, "was altered (checksum differs)"),
    "more than memory": ({"files": {"a": {"bytes": 1 << 62, "sha256": "0" * 64}}}, "set LAVA_VPR_MAX_BUNDLE_BYTES"),
    "many files": (
        {"files": {f"f{k}": {"bytes": 1, "sha256": "0" * 64} for k in range(10_001)}},
        "lists 10,001 files, more than the 10,000 allowed; if the file is sound, set LAVA_VPR_MAX_BUNDLE_FILES",
    ),
}
NAMES = ("", ".", "..", "/etc/passwd", "a\0b", "a\\b", "a/../b", "a//b", "./a", "a/", "\ud800", "\x1b[2J", "x" * 201)
NAMES += ("readme.MD", MANIFEST, "\u212a", ".hidden", "a b")
FORGED |= {
    f"a file {name!r:.20}": (
        {"files": {"README.md": {"bytes": 1, "sha256": "0" * 64}, name: {"bytes": 1, "sha256": "0" * 64}}},
        f"names {brief(name)}, which is not in the bundle",
    )
    for name in NAMES
}


@pytest.mark.parametrize("kind", FORGED)
def test_a_forged_manifest_is_refused(intact: Path, kind: str) -> None:
    changes, said = FORGED[kind]
    manifest = json.loads((intact / MANIFEST).read_bytes()) | changes
    if "sha256" not in changes and kind != "a number beyond all floats":
        manifest["sha256"] = self_digest(manifest)
    (intact / MANIFEST).write_text(json.dumps(manifest).replace("Infinity", "1e999"))
    with pytest.raises(BundleError) as caught:
        load(intact)
    text = str(caught.value)
    assert text.startswith(f"{intact / MANIFEST}: ")
    assert said in text
    assert "; " in text
    assert text.isprintable()
    assert len(text) < 500


TEXTS = {
    "deep": b"[" * 100_000,
    "deep objects": b'{"a":' * 100_000,
    "a long number": b'{"format": ' + b"9" * 10_000 + b"}",
    "no number": b'{"format": NaN}',
    "no text": b"\xff\xfe",
    "a key twice": b'{"format": 1, "format": 2}',
}


@pytest.mark.parametrize("kind", TEXTS)
def test_a_manifest_that_breaks_readers(intact: Path, kind: str) -> None:
    (intact / MANIFEST).write_bytes(TEXTS[kind])
    with pytest.raises(BundleError, match=rf"{MANIFEST}: is no JSON \(.*\); deploy the model again"):
        load(intact)
    with pytest.raises(BundleError, match="holds something else than a bundle; name another folder"):
        check_replaceable(intact)


def test_pipes_are_not_waited_for(intact: Path) -> None:
    for name in ("README.md", MANIFEST):
        (intact / name).unlink()
        os.mkfifo(intact / name)
        why = r"cannot be read \(is a named pipe, not a file\); check it and its permissions$"
        with pytest.raises(BundleError, match=f"{name}: {why}"):
            load(intact)
    with pytest.raises(BundleError, match="holds something else than a bundle"):
        check_replaceable(intact)


def test_a_link_may_not_lead_out(intact: Path, tmp_path: Path) -> None:
    (intact / "README.md").rename(tmp_path / "elsewhere")
    (intact / "README.md").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BundleError, match=r"README.md: is a link that leads out of the bundle; put the file itself"):
        load(intact)
    (tmp_path / "link").symlink_to(intact)
    (intact / "README.md").unlink()
    (tmp_path / "elsewhere").rename(intact / "README.md")
    assert load(tmp_path / "link").files == FILES, "the folder itself may be a link"


def test_lengths_are_seen_before_anything_is_read(intact: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.truncate(intact / "README.md", 1 << 40)
    with pytest.raises(BundleError, match=r"README.md: has 1,099,511,627,776 bytes instead of 8"):
        load(intact)
    flip(intact / SYNAPSES)
    monkeypatch.setenv("LAVA_VPR_MAX_BUNDLE_BYTES", "300")
    with pytest.raises(
        BundleError, match=r"lists \d+ bytes, more than the 300 allowed; if the file is sound, set LAVA"
    ):
        load(intact)


ARRAYS = {
    "a huge header": ("<i4", "(99999999999, 4), ", "says int32 (99999999999, 4), but 64 bytes follow"),
    "a product beyond 64 bits": ("<i4", "(99999999999, 99999999999, 0), ", "but 64 bytes follow"),
    "objects": ("|O", "(8,), ", "pickled objects"),
    "Python": ("<i4", "(" * 400 + ")" * 400, "it does not begin as numpy.save would write it"),
    "negative": ("<i4", "(-16,), ", "it does not begin as numpy.save would write it"),
    "big endian": (">i4", "(16,), ", "but of '>i4'"),
    "text": ("<U4", "(4,), ", "but of '<U4'"),
}


@pytest.mark.parametrize("kind", ARRAYS)
def test_the_header_of_an_array_is_not_believed(kind: str) -> None:
    descr, shape, said = ARRAYS[kind]
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    data = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + b"\0" * 64
    with pytest.raises(BundleError) as caught:
        ReadBundle(Path("b"), {}, {"a.npy": data}).array("a.npy")
    assert str(caught.value).startswith("b/a.npy: is no array of numbers (")
    assert said in str(caught.value)


def test_an_array_is_of_its_type_and_shape() -> None:
    held = ReadBundle(Path("b"), {}, {"a.npy": array_bytes(np.arange(6, dtype=np.int32).reshape(2, 3))})
    assert held.array("a.npy", np.int32, ("rows", 3)).tolist() == [[0, 1, 2], [3, 4, 5]]
    with pytest.raises(BundleError, match=r"^b/a.npy: is int32 \(2, 3\), but must be int64 \(rows, 3\); deploy the"):
        held.array("a.npy", np.int64, ("rows", 3))
    for shape in (("rows",), ("rows", 4), (1, 3), ("rows", 3, 1)):
        with pytest.raises(BundleError, match=r"is int32 \(2, 3\), but must be"):
            held.array("a.npy", np.int32, shape)


def test_json_is_not_read_beyond_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    held = ReadBundle(Path("b"), {}, {"a.json": b"[" + b"1, " * 200 + b"1]"})
    monkeypatch.setenv("LAVA_VPR_MAX_BUNDLE_JSON_BYTES", "100")
    with pytest.raises(BundleError, match=r"^b/a.json: has 603 bytes, more than the 100 allowed; if the file is sound"):
        held.json("a.json")


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


@pytest.mark.parametrize("exchanged", [True, False])
def test_a_bundle_is_replaced_in_one_step(intact: Path, exchanged: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not exchanged:
        monkeypatch.setattr(bundle.ctypes, "CDLL", lambda *a, **k: object())  # an old C library
    write(intact, TOLD, {"only": b"new"})
    assert sorted(tree(intact)) == [MANIFEST, "only"]
    assert [entry.name for entry in intact.parent.iterdir()] == ["bundle"], "something was left beside it"


@pytest.mark.usefixtures("ctrl_c")
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


@pytest.mark.parametrize("stopped", [OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), KeyboardInterrupt()])
def test_what_ends_the_writing_leaves_what_was_there(
    intact: Path, monkeypatch: pytest.MonkeyPatch, stopped: BaseException
) -> None:
    before = tree(intact)

    def stop(handle: int) -> None:
        raise stopped

    monkeypatch.setattr(bundle.os, "fsync", stop)
    with pytest.raises((BundleError, KeyboardInterrupt)) as caught:
        write(intact, TOLD, {"only": b"new"})
    full = "cannot be written (No space left on device); free space or choose"
    assert full in str(caught.value) or stopped is caught.value
    assert tree(intact) == before
    assert [entry.name for entry in intact.parent.iterdir()] == ["bundle"]
