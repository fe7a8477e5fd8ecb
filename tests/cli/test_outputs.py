"""An output that is an input, spoils one, or cannot be written is refused before any work, and nothing is lost."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner
from support.common.commands import run
from support.common.imagefiles import write_images

from lava_vpr.cli import main
from lava_vpr.synthetic.world import write_traverses

LONG = "n" * 250


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images of six places, their model ``m.lvpr`` and its bundle ``b``; tests work on copies."""
    root = tmp_path_factory.mktemp("made")
    write_images(root / "ref", 6)
    write_images(root / "query", 6)
    (root / "quick.toml").write_text("[network]\nsteps = 32\n[learning]\nsteps = 40\nepochs = 2\n")
    run("train", root / "ref", "-o", root / "m.lvpr", "--config", root / "quick.toml")
    run("deploy", root / "m.lvpr", "--target", "loihi2", "-o", root / "b")
    (root / "list.txt").write_text("".join(f"query/img{k}.png\n" for k in range(6)))
    (root / "gt.txt").write_text("".join(f"{k}: {k}\n" for k in range(6)))
    (root / "xy.csv").write_text("x,y\n" + "".join(f"{k},0\n" for k in range(6)))
    return root


@pytest.fixture
def place(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(made, tmp_path / "w")
    monkeypatch.chdir(tmp_path / "w")
    return tmp_path / "w"


def content(folder: Path) -> dict[Path, tuple[int, bytes]]:
    """Mode and bytes of every file below ``folder``, hidden ones too, and the modes of folders."""
    return {path: (path.lstat().st_mode, path.read_bytes() if path.is_file() else b"") for path in folder.rglob("*")}


def nothing() -> None:
    pass


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
    for name in ("q.csv", "q.json", "n.lvpr", "o.lvpr.checkpoint", "r/report.html"):
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
    os.symlink("thesis.tex", ".n.lvpr.lock")


def lock_dangles() -> None:
    os.symlink("nowhere", ".n.lvpr.lock")


def lock_holds_data() -> None:
    Path(".n.lvpr.lock").write_text("years of work")


def lock_is_a_pipe() -> None:
    os.mkfifo(".n.lvpr.lock")


def lock_is_a_folder() -> None:
    Path(".n.lvpr.lock").mkdir()


def read_only_bundle() -> None:
    Path("b").chmod(0o555)


def read_only_in_bundle() -> None:
    Path("b/mapping.json").chmod(0o444)


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
PROTECTED = "is read-only and would be replaced; make it writable"
REFUSED = [
    (nothing, "query b query -o b/manifest.json", f"b/manifest.json: {IN_BUNDLE}"),
    (nothing, "query b query -o b/matches.csv", f"b/matches.csv: {IN_BUNDLE}"),
    (nothing, "query b query -o ref/../b/host/new/q.csv", f"ref/../b/host/new/q.csv: {IN_BUNDLE}"),
    (links, "query b query -o c/q.csv", f"c/q.csv: {IN_BUNDLE}"),
    (links, "query c query -o b/q.csv", "b/q.csv: would stand in the bundle c, which"),
    (nothing, "eval b query --json b/host/references.lvpr", f"b/host/references.lvpr: {IN_BUNDLE}"),
    (nothing, "eval b query --report b", f"b/report.html: {IN_BUNDLE}"),
    (nothing, "eval b query --report b/host/page", f"b/host/page/report.html: {IN_BUNDLE}"),
    (nothing, "bench b query --json b/mapping.json", f"b/mapping.json: {IN_BUNDLE}"),
    (nothing, "bench b query --report b", f"b/bench.html: {IN_BUNDLE}"),
    (nothing, "verify b query --json b/manifest.json", f"b/manifest.json: {IN_BUNDLE}"),
    (nothing, "fit b --target loihi2 --json b/mapping.json", f"b/mapping.json: {IN_BUNDLE}"),
    (nothing, "fit b --target loihi2 --picture b/mapping.svg", f"b/mapping.svg: {IN_BUNDLE}"),
    (nothing, f"{DEPLOY} -o x --json b/f.json", f"b/f.json: {IN_BUNDLE}"),
    (nothing, f"{DEPLOY} -o b", "b: is also the model, which would be replaced; name another place"),
    (nothing, f"{DEPLOY} -o b/c", f"b/c: {IN_BUNDLE}"),
    (nothing, f"{DEPLOY} -o x --json x/f.json", "x/f.json: would stand in the bundle x, which holds its own files"),
    (nothing, f"{DEPLOY} -o x --json x", f"x: {TWICE}"),
    (hard_links, "query m.lvpr query -o q.csv", f"q.csv: {INPUT}"),
    (hard_links, "eval m.lvpr query --json q.json", f"q.json: {INPUT}"),
    (links, "query m.lvpr query -o q.csv", f"q.csv: {INPUT}"),
    (nothing, "query m.lvpr list.txt -o query/img5.png --places 0:2", f"query/img5.png: {INPUT}"),
    (nothing, f"{TRAIN} query -o query/img3.png --places 0:2", f"query/img3.png: {INPUT}"),
    (nothing, "eval m.lvpr query --gt gt.txt --json gt.txt", f"gt.txt: {INPUT}"),
    (nothing, "eval m.lvpr query --positions xy.csv xy.csv --radius 1 --json ./xy.csv", f"xy.csv: {INPUT}"),
    (nothing, "eval m.lvpr query --descriptors xy.csv gt.txt --json gt.txt", f"gt.txt: {INPUT}"),
    (nothing, "verify m.lvpr query --json query/img0.png", f"query/img0.png: {INPUT}"),
    (report_folder, "eval r/report.html query --report r", f"r/report.html: {INPUT}"),
    (report_folder, "bench m.lvpr r/bench.html --report r", f"r/bench.html: {INPUT}"),
    (nothing, "query m.lvpr query -o query/new.JPG", f"query/new.JPG: {IMAGE}"),
    (nothing, "query m.lvpr query -o ref/../query/new.png", f"ref/../query/new.png: {IMAGE}"),
    (links, "query m.lvpr query -o images/new.png", f"images/new.png: {IMAGE}"),
    (nothing, f"{TRAIN} query -o query/model.png", f"query/model.png: {IMAGE}"),
    (report_folder, "eval m.lvpr query --json r/report.html --report r", f"r/report.html: {TWICE}"),
    (
        nothing,
        "eval m.lvpr query --json new --report new",
        "new/report.html: would stand in new, which is to be a file",
    ),
    (
        nothing,
        "bench m.lvpr query --json new --report new",
        "new/bench.html: would stand in new, which is to be a file",
    ),
    (nothing, f"{FIT} --json x.svg --picture ref/../x.svg", f"x.svg: {TWICE}"),
    (nothing, f"{TRAIN} -o n.lvpr --config n.lvpr.checkpoint", "n.lvpr.checkpoint: "),
    (read_only, "query m.lvpr query -o q.csv", f"q.csv: {CLOSED}"),
    (read_only, "eval m.lvpr query --json q.json", f"q.json: {CLOSED}"),
    (read_only, "eval m.lvpr query --report r", f"r/report.html: {CLOSED}"),
    (read_only, f"{TRAIN} -o n.lvpr", f"n.lvpr: {CLOSED}"),
    (read_only, f"{TRAIN} -o o.lvpr --resume", f"o.lvpr.checkpoint: {CLOSED}"),
    (in_the_way, "eval m.lvpr query --report file/deep/er", "file: is a file; name a folder"),
    (in_the_way, "demo --out d", "d/report/report.html: is a folder; name a file"),
    (in_the_way, "query m.lvpr query -o pipe", "pipe: cannot be written (is a folder, device or pipe, not a file)"),
    (read_only_bundle, "deploy m.lvpr --target loihi2 -o b", f"b: {PROTECTED} or name another folder"),
    (read_only_in_bundle, "deploy m.lvpr --target loihi2 -o b", f"b/mapping.json: {PROTECTED} or name another folder"),
    (read_only_image, "synth s --places 2", f"s/query/place_00001.png: {PROTECTED} or choose another folder"),
    (read_only_folder, "synth s --places 3", f"s/reference: {PROTECTED} or choose another folder"),
    (in_the_way, "query m.lvpr query -o dangling", "/no does not exist; create it first"),
    (in_the_way, "query m.lvpr query -o loop", "loop: cannot be written (Too many levels of symbolic links); name"),
    (lock_is_a_folder, f"{TRAIN} -o n.lvpr", "(.n.lvpr.lock beside it: Is a directory); remove that or choose"),
    (own_model, "demo --out d", "d: holds something else (model.lvpr); choose a new or an empty folder"),
    (nothing, f"query m.lvpr query -o {LONG}{LONG}", f"{LONG[:200]}: cannot be written (File name too long); name"),
    (nothing, f"{TRAIN} -o {LONG}", f"{LONG}.checkpoint: cannot be written (File name too long); name another"),
    (lock_is_a_link, f"{TRAIN} -o n.lvpr", "n.lvpr: cannot be locked (.n.lvpr.lock beside it: a symbolic link, not a"),
    (lock_dangles, f"{TRAIN} -o n.lvpr", "n.lvpr: cannot be locked (.n.lvpr.lock beside it: a symbolic link, not a"),
    (lock_holds_data, f"{TRAIN} -o n.lvpr", "n.lvpr: cannot be locked (.n.lvpr.lock beside it: data, not a lock)"),
    (lock_is_a_pipe, f"{TRAIN} -o n.lvpr", "n.lvpr: cannot be locked (.n.lvpr.lock beside it: not a file)"),
]


@pytest.mark.parametrize(("prepare", "command", "message"), REFUSED, ids=[f"{p.__name__}: {c}" for p, c, _ in REFUSED])
def test_an_output_in_the_way_is_refused(
    prepare: Callable[[], None], command: str, message: str, place: Path, tmp_path: Path
) -> None:
    prepare()
    before = content(place)
    result = CliRunner().invoke(main, command.split())
    assert (result.exit_code, result.stdout) == (1, ""), result.output
    (line,) = result.stderr.splitlines()
    assert line.startswith("lava-vpr: error: ")
    assert message in line
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
    Path(".n.lvpr.lock").touch()
    run("train", "ref", "-o", "n.lvpr", "--config", "quick.toml")
    assert not Path(".n.lvpr.lock").exists()


def test_a_pipe_that_has_no_name_is_no_file(place: Path) -> None:
    """As ``-o /dev/stdout`` in a pipe; the link there leads nowhere."""
    reader, writer = os.pipe()
    try:
        result = CliRunner().invoke(main, ["query", "m.lvpr", "none", "-o", f"/proc/self/fd/{writer}"])
    finally:
        os.close(reader)
        os.close(writer)
    assert "cannot be written (is a folder, device or pipe, not a file); name another" in result.stderr


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
    result = CliRunner().invoke(main, command.replace(" b", f" {place}/b").replace(" s ", f" {place}/s ").split())
    assert f"{closed}: is read-only and would be replaced; make it writable or" in result.stderr
    assert content(place) == before
