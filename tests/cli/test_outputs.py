"""An output that is an input, spoils one, or cannot be written is refused before any work, and nothing is lost."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from support.common.commands import content, fails, run

from lava_vpr.synthetic.world import write_traverses

LONG = "n" * 250
LOCK = ".n.lvpr.lock"


def hard_links() -> None:
    os.link("query/img2.png", "q.csv")
    os.link("m.lvpr", "q.json")


def links() -> None:
    os.symlink("query/img2.png", "q.csv")
    os.symlink("b", "c")
    os.symlink("query", "images")


def report_folder() -> None:
    Path("r").mkdir()
    shutil.copy("m.lvpr", "r/report.html")
    shutil.copy("query/img0.png", "r/bench.html")
    Path("r/list.txt").write_text(Path("list.txt").read_text().replace("query", "../query"))


def read_only() -> None:
    report_folder()
    for name in ("q.csv", "q.json", "n.lvpr", "o.lvpr.checkpoint", "r/report.html", "r/query.html"):
        Path(name).write_bytes(b"kept")
        Path(name).chmod(0o444)


def in_the_way() -> None:
    Path("file").write_text("a file")
    Path("d/report/report.html").mkdir(parents=True)
    os.mkfifo("pipe")
    os.symlink("no/such", "dangling")
    os.symlink("loop", "loop")


def lock_is_a_link() -> None:
    Path("thesis.tex").write_text("years of work")
    os.symlink("thesis.tex", LOCK)


def read_only_image() -> None:
    write_traverses(Path("s"), 2, 0)
    Path("s/query/place_00001.png").chmod(0o444)


def read_only_folder() -> None:
    write_traverses(Path("s"), 2, 0)
    Path("s/reference").chmod(0o555)


def own_model() -> None:
    Path("d").mkdir()
    shutil.copy("m.lvpr", "d/model.lvpr")


TRAIN = "train ref --config quick.toml"
FIT = "fit m.lvpr --target loihi2"
DEPLOY = "deploy b --target loihi2"
IN_BUNDLE = "would stand in the bundle b, which holds its own files alone; name another place"
INPUT = "is also an input, which would be replaced; name another file"
TWICE = "is named for two outputs; name another for one of them"
IMAGE = "would be one more image in query, which is read; name it otherwise"
CLOSED = "cannot be written (the file there is read-only); make it writable or name another"
PIPE = "cannot be written (is a folder, device or pipe, not a file)"
PROTECTED = "is read-only and would be replaced; make it writable"
LOCKED = f"n.lvpr: cannot be locked ({LOCK} beside it: "
NEW = f"{TRAIN} -o n.lvpr"
TO_LOIHI = "deploy m.lvpr --target loihi2 -o b"
REFUSED: list[tuple[Callable[[], object] | None, str, str]] = [
    (None, "query b query -o b/manifest.json", f"b/manifest.json: {IN_BUNDLE}"),
    (None, "query b query -o b/matches.csv", f"b/matches.csv: {IN_BUNDLE}"),
    (None, "query b query -o ref/../b/host/new/q.csv", f"ref/../b/host/new/q.csv: {IN_BUNDLE}"),
    (links, "query b query -o c/q.csv", f"c/q.csv: {IN_BUNDLE}"),
    (links, "query c query -o b/q.csv", "b/q.csv: would stand in the bundle c, which"),
    (None, "eval b query --json b/host/references.lvpr", f"b/host/references.lvpr: {IN_BUNDLE}"),
    (None, "eval b query --report b", f"b/report.html: {IN_BUNDLE}"),
    (None, "query b query --report b", f"b/query.html: {IN_BUNDLE}"),
    (None, "eval b query --report b/host/page", f"b/host/page/report.html: {IN_BUNDLE}"),
    (None, "bench b query --json b/mapping.json", f"b/mapping.json: {IN_BUNDLE}"),
    (None, "bench b query --report b", f"b/bench.html: {IN_BUNDLE}"),
    (None, "verify b query --json b/manifest.json", f"b/manifest.json: {IN_BUNDLE}"),
    (None, "fit b --target loihi2 --json b/mapping.json", f"b/mapping.json: {IN_BUNDLE}"),
    (None, "fit b --target loihi2 --picture b/mapping.svg", f"b/mapping.svg: {IN_BUNDLE}"),
    (None, f"{DEPLOY} -o x --json b/f.json", f"b/f.json: {IN_BUNDLE}"),
    (None, f"{DEPLOY} -o b", "b: is also the model, which would be replaced; name another place"),
    (None, f"{DEPLOY} -o b/c", f"b/c: {IN_BUNDLE}"),
    (None, f"{DEPLOY} -o x --json x/f.json", "x/f.json: would stand in the bundle x, which holds its own files"),
    (None, f"{TO_LOIHI} --json b/d.json", "b/d.json: would stand in the bundle b, which holds its own files"),
    (None, f"{DEPLOY} -o x --json x", f"x: {TWICE}"),
    (hard_links, "query m.lvpr query -o q.csv", f"q.csv: {INPUT}"),
    (hard_links, "eval m.lvpr query --json q.json", f"q.json: {INPUT}"),
    (links, "query m.lvpr query -o q.csv", f"q.csv: {INPUT}"),
    (hard_links, "query m.lvpr query --scores q.csv", f"q.csv: {INPUT}"),
    (None, "query m.lvpr list.txt -o query/img5.png --places 0:2", f"query/img5.png: {INPUT}"),
    (None, f"{TRAIN} query -o query/img3.png --places 0:2", f"query/img3.png: {INPUT}"),
    (None, "eval m.lvpr query --gt gt.txt --json gt.txt", f"gt.txt: {INPUT}"),
    (None, "eval m.lvpr query --positions xy.csv xy.csv --radius 1 --json ./xy.csv", f"xy.csv: {INPUT}"),
    (None, "eval m.lvpr query --descriptors xy.csv gt.txt --json gt.txt", f"gt.txt: {INPUT}"),
    (None, "verify m.lvpr query --json query/img0.png", f"query/img0.png: {INPUT}"),
    (report_folder, "eval r/report.html query --report r", f"r/report.html: {INPUT}"),
    (report_folder, "bench m.lvpr r/bench.html --report r", f"r/bench.html: {INPUT}"),
    (None, "query m.lvpr query -o query/new.JPG", f"query/new.JPG: {IMAGE}"),
    (None, "query m.lvpr query -o ref/../query/new.png", f"ref/../query/new.png: {IMAGE}"),
    (links, "query m.lvpr query -o images/new.png", f"images/new.png: {IMAGE}"),
    (None, f"{TRAIN} query -o query/model.png", f"query/model.png: {IMAGE}"),
    (report_folder, "eval m.lvpr query --json r/report.html --report r", f"r/report.html: {TWICE}"),
    (
        None,
        "eval m.lvpr query --json new --report new",
        "new/report.html: would stand in new, which is to be a file",
    ),
    (
        None,
        "bench m.lvpr query --json new --report new",
        "new/bench.html: would stand in new, which is to be a file",
    ),
    (None, f"{FIT} --json x.svg --picture ref/../x.svg", f"x.svg: {TWICE}"),
    (None, f"{TRAIN} -o n.lvpr --config n.lvpr.checkpoint", "n.lvpr.checkpoint: "),
    (read_only, "query m.lvpr query -o q.csv", f"q.csv: {CLOSED}"),
    (read_only, "eval m.lvpr query --json q.json", f"q.json: {CLOSED}"),
    (read_only, "eval m.lvpr query --report r", f"r/report.html: {CLOSED}"),
    (read_only, f"{TRAIN} -o n.lvpr", f"n.lvpr: {CLOSED}"),
    (read_only, f"{TRAIN} -o o.lvpr --resume", f"o.lvpr.checkpoint: {CLOSED}"),
    (in_the_way, "eval m.lvpr query --report file/deep/er", "file: is a file; name a folder"),
    (in_the_way, "query m.lvpr query --report file", "file: is a file; name a folder"),
    (read_only, "query m.lvpr query --report r", f"r/query.html: {CLOSED}"),
    (in_the_way, "demo --out d", "d/report/report.html: is a folder; name a file"),
    (in_the_way, "query m.lvpr query -o pipe", f"pipe: {PIPE}"),  # a rename would replace even a device
    (in_the_way, "eval m.lvpr query --json pipe", f"pipe: {PIPE}"),
    (in_the_way, f"{TRAIN} -o pipe", f"pipe: {PIPE}"),
    (partial(os.chmod, "b", 0o555), TO_LOIHI, f"b: {PROTECTED} or name another folder"),
    (
        partial(os.chmod, "b/mapping.json", 0o444),
        "deploy m.lvpr --target loihi2 -o b",
        f"b/mapping.json: {PROTECTED} or name another folder",
    ),
    (read_only_image, "synth s --places 2", f"s/query/place_00001.png: {PROTECTED} or choose another folder"),
    (read_only_folder, "synth s --places 3", f"s/reference: {PROTECTED} or choose another folder"),
    (in_the_way, "query m.lvpr query -o dangling", "/no does not exist; create it first"),
    (in_the_way, "query m.lvpr query -o loop", "loop: cannot be written (Too many levels of symbolic links); name"),
    (partial(os.mkdir, LOCK), f"{TRAIN} -o n.lvpr", "(.n.lvpr.lock beside it: Is a directory); remove that or choose"),
    (own_model, "demo --out d", "d: holds something else (model.lvpr); choose a new or an empty folder"),
    (None, f"query m.lvpr query -o {LONG}{LONG}", f"{LONG[:200]}: cannot be written (File name too long); name"),
    (None, f"{TRAIN} -o {LONG}", f"{LONG}.checkpoint: cannot be written (File name too long); name another"),
    (lock_is_a_link, NEW, f"{LOCKED}a symbolic link, not a"),
    (
        partial(os.symlink, "nowhere", LOCK),
        f"{TRAIN} -o n.lvpr",
        "n.lvpr: cannot be locked (.n.lvpr.lock beside it: a symbolic link, not a",
    ),
    (
        partial(Path(LOCK).write_text, "years of work"),
        f"{TRAIN} -o n.lvpr",
        "n.lvpr: cannot be locked (.n.lvpr.lock beside it: data, not a lock)",
    ),
    (partial(os.mkfifo, LOCK), NEW, f"{LOCKED}not a file)"),
]


@pytest.mark.parametrize(("prepare", "command", "message"), REFUSED, ids=[command[:80] for _, command, _ in REFUSED])
def test_an_output_in_the_way_is_refused(
    prepare: Callable[[], object] | None, command: str, message: str, place: Path, tmp_path: Path
) -> None:
    if prepare is not None:
        prepare()
    before = content(place)
    assert message in fails(*command.split())
    assert content(tmp_path / "w") == before


ACCEPTED = [
    ("query m.lvpr query -o query/matches.csv", "query/matches.csv"),
    ("query m.lvpr query -o ref/new.png", "ref/new.png"),
    ("query m.lvpr query -o query/.hidden.png", "query/.hidden.png"),
    (f"query m.lvpr query -o {LONG}", LONG),
    (f"train ref --config quick.toml -o {LONG[:240]}", LONG[:240]),
]


@pytest.mark.parametrize(("command", "output"), ACCEPTED, ids=[command[:60] for command, _ in ACCEPTED])
def test_an_output_beside_the_inputs_is_written(command: str, output: str, place: Path) -> None:
    before = content(place)
    run(*command.split())
    after = content(place)
    assert Path(output).stat().st_size > 0
    assert {path: value for path, value in after.items() if path in before} == before
    assert set(after) - set(before) == {place / output}


def test_results_keep_the_modes_of_those_before_them(place: Path) -> None:
    results = ("m.lvpr", "q.csv", "query/f.json", "query/report.html")  # other files may stand beside images
    for name in results:
        Path(name).touch()
        Path(name).chmod(0o600)
    run("train", "ref", "-o", "m.lvpr", "--config", "quick.toml")
    run("query", "m.lvpr", "query", "-o", "q.csv")
    run("eval", "m.lvpr", "query", "--json", "query/f.json", "--report", "query")
    assert {name: Path(name).stat().st_mode & 0o777 for name in results} == dict.fromkeys(results, 0o600)
    assert all(Path(name).stat().st_size for name in results)


def test_folders_of_results_keep_the_modes_of_those_before_them(place: Path) -> None:
    words = {"b": ("deploy", "m.lvpr", "--target", "loihi2", "-o", "b"), "s": ("synth", "s", "--places", "2")}
    run(*words["s"])
    closed = {"b": 0o700, "b/manifest.json": 0o600, "s": 0o750, "s/query": 0o700, "s/query/place_00001.png": 0o640}
    numbers = {name: Path(name).stat().st_ino for name in ("b", "s/query")}
    for name, bits in closed.items():
        Path(name).chmod(bits)
    for command in words.values():
        run(*command)
    assert {name: Path(name).stat().st_mode & 0o777 for name in closed} == closed
    assert all(Path(name).stat().st_ino != number for name, number in numbers.items())


def test_folders_of_results_may_have_long_names(place: Path) -> None:
    run("deploy", "m.lvpr", "--target", "loihi2", "-o", LONG)
    run("synth", f"s/{LONG}", "--places", "2")
    assert Path(LONG, "manifest.json").exists()
    assert Path("s", LONG, "query_positions.csv").exists()


def test_a_lock_that_a_killed_training_left_locks_nobody_out(place: Path) -> None:
    Path(LOCK).touch()
    run("train", "ref", "-o", "n.lvpr", "--config", "quick.toml")
    assert not Path(LOCK).exists()


def test_a_pipe_that_has_no_name_is_no_file(place: Path) -> None:
    """As ``-o /dev/stdout`` in a pipe; the link there leads nowhere."""
    reader, writer = os.pipe()
    try:
        said = fails("query", "m.lvpr", "none", "-o", f"/proc/self/fd/{writer}")
    finally:
        os.close(reader)
        os.close(writer)
    assert "cannot be written (is a folder, device or pipe, not a file); name another" in said


@pytest.mark.parametrize(
    ("command", "closed"), [("deploy m.lvpr --target loihi2 -o b", "b/host"), ("synth s --places 2", "s/query")]
)
def test_folders_of_others_are_not_replaced(
    command: str, closed: str, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was in them could not be removed afterwards."""
    write_traverses(Path("s"), 2, 0)
    before = content(place)
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != (place / closed) and access(path, mode))
    monkeypatch.chdir(place)
    said = fails(*command.replace(" b", f" {place}/b").replace(" s ", f" {place}/s ").split())
    assert f"{closed}: is read-only and would be replaced; make it writable or" in said
    assert content(place) == before
