"""Ways to call the command line wrongly, or with files that cannot be used: each ends in one clear line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result
from support.common.imagefiles import blocky_picture, write_images

from lava_vpr.cli import main

CONFIG = "[network]\nsteps = 32\n[learning]\nsteps = 40\nepochs = 2\n"


def run(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with good images and a good model; tests copy it before they damage anything."""
    root = tmp_path_factory.mktemp("good")
    write_images(root / "ref", 6)
    write_images(root / "query", 6)
    (root / "quick.toml").write_text(CONFIG)
    result = run("train", root / "ref", "-o", root / "m.lvpr", "--config", root / "quick.toml")
    assert result.exit_code == 0, result.output
    part = run("train", root / "ref", "-o", root / "m4.lvpr", "--config", root / "quick.toml", "--places", "0:4")
    assert part.exit_code == 0, part.output
    return root


@pytest.fixture
def here(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(place, tmp_path / "w")
    monkeypatch.chdir(tmp_path / "w")
    return tmp_path / "w"


def nothing(here: Path) -> None:
    pass


def empty_folder(here: Path) -> None:
    (here / "empty").mkdir()


def no_images(here: Path) -> None:
    (here / "texts").mkdir()
    (here / "texts" / "a.txt").write_text("hello")


def truncated(here: Path) -> None:
    path = here / "ref" / "img3.png"
    path.write_bytes(path.read_bytes()[:60])


def zero_bytes(here: Path) -> None:
    (here / "query" / "img2.png").write_bytes(b"")


def renamed_text(here: Path) -> None:
    (here / "ref" / "img1.png").write_text("I am no image")


def missing_in_list(here: Path) -> None:
    (here / "list.txt").write_text("ref/img0.png\nref/none.png\n")


def empty_list(here: Path) -> None:
    (here / "list.txt").write_text("# nothing\n")


def bad_video(here: Path) -> None:
    (here / "v.mp4").write_bytes(b"not a video")


def nan_image(here: Path) -> None:
    cv2.imwrite(str(here / "ref" / "img2.tif"), np.full((20, 30), np.nan, np.float32))


def one_more_query(here: Path) -> None:
    cv2.imwrite(str(here / "query" / "img9.png"), blocky_picture(77))


def more_queries(here: Path) -> None:
    write_images(here / "query", 9)


def good_list(here: Path) -> None:
    (here / "list.txt").write_text("ref/img0.png\nref/img1.png\n")


def conflicting_presets(here: Path) -> None:
    (here / "bad.toml").write_text("preset = 'loihi'\n")


def endless_theta(here: Path) -> None:
    (here / "bad.toml").write_text("preset = 'paper'\n[learning]\ntau_theta_ms = inf\n")


def one_image(here: Path) -> None:
    write_images(here / "one", 1)


def shorter_second(here: Path) -> None:
    write_images(here / "ref2", 5)


def damaged_model(here: Path) -> None:
    data = (here / "m.lvpr").read_bytes()
    (here / "m.lvpr").write_bytes(data[: len(data) // 2])


def foreign_model(here: Path) -> None:
    np.savez(here / "m.npz", a=np.zeros(3))


def empty_model(here: Path) -> None:
    (here / "e.lvpr").write_bytes(b"")


def bad_toml(here: Path) -> None:
    (here / "bad.toml").write_text("[network\n")


def unknown_setting(here: Path) -> None:
    (here / "bad.toml").write_text("[network]\nneuron_count = 3\n")


def out_of_range(here: Path) -> None:
    (here / "bad.toml").write_text("[learning]\neta = -3.0\n")


def overflowing(here: Path) -> None:
    (here / "bad.toml").write_text(CONFIG.replace("[network]\n", "[network]\nthreshold = 1.0\ninhibition = 9000.0\n"))


def checkpoint(here: Path) -> None:
    (here / "n.lvpr.checkpoint").write_bytes(b"lava-vpr checkpoint 1\nrest")


def garbled_gt(here: Path) -> None:
    (here / "gt.txt").write_text("0: 1\n1: two\n")


def gt_of_nobody(here: Path) -> None:
    (here / "gt.json").write_text(json.dumps({"900": [1]}))


def short_positions(here: Path) -> None:
    (here / "r.csv").write_text("x,y\n" + "".join(f"{k},0\n" for k in range(6)))
    (here / "q.csv").write_text("x,y\n0,0\n1,0\n")


def nan_positions(here: Path) -> None:
    (here / "r.csv").write_text("x,y\n" + "".join(f"{k},0\n" for k in range(6)))
    (here / "q.csv").write_text("x,y\n0,0\n1,nan\n2,0\n3,0\n4,0\n5,0\n")


def nan_descriptors(here: Path) -> None:
    np.save(here / "r.npy", np.ones((6, 4)))
    np.save(here / "q.npy", np.full((6, 4), np.nan))


def few_descriptors(here: Path) -> None:
    np.save(here / "r.npy", np.ones((5, 4)))
    np.save(here / "q.npy", np.ones((6, 4)))


def pickled_descriptors(here: Path) -> None:
    np.save(here / "r.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    np.save(here / "q.npy", np.ones((6, 4)))


def file_in_the_way(here: Path) -> None:
    (here / "out").write_text("a file")


def someone_elses_folder(here: Path) -> None:
    (here / "out").mkdir()
    (here / "out" / "thesis.tex").write_text("years of work")


TRAIN = "train {} -o n.lvpr --config quick.toml"
DATA = [
    (nothing, "train none -o n.lvpr", "none: cannot be opened (No such file or directory)"),
    (empty_folder, "train empty -o n.lvpr", "empty: "),
    (no_images, "train texts -o n.lvpr", "texts: "),
    (truncated, TRAIN.format("ref"), "img3.png: "),
    (zero_bytes, "eval m.lvpr query", "img2.png: "),
    (renamed_text, TRAIN.format("ref"), "img1.png: "),
    (nan_image, TRAIN.format("ref"), "img2.tif: "),
    (missing_in_list, TRAIN.format("list.txt"), "none.png"),
    (empty_list, TRAIN.format("list.txt"), "list.txt: "),
    (bad_video, TRAIN.format("v.mp4"), "v.mp4: "),
    (nothing, TRAIN.format("quick.toml"), "quick.toml: is of no known type"),
    (nothing, TRAIN.format("ref") + " --places 0:50", "ref: has 6 images; places 0:50 go beyond, use at most 0:6"),
    (nothing, TRAIN.format("ref") + " --every 0", "--every is 0"),
    (nothing, TRAIN.format("ref") + " --every nan", "--every is nan"),
    (one_image, TRAIN.format("one"), "one: a route needs at least 2 places, but there is 1 image; give a folder"),
    (nothing, TRAIN.format("ref") + " --places 2:3", "ref: a route needs at least 2 places, but there is 1 image"),
    (shorter_second, TRAIN.format("ref ref2"), "ref2: reference traverse 2 has 5 images, the first has 6"),
    (nothing, "train ref -o no/such/n.lvpr", "no/such/n.lvpr: the folder no/such does not exist; create it first"),
    (nothing, "train ref -o query", "query: is a folder; name a file"),
    (bad_toml, "train ref -o n.lvpr --config bad.toml", "bad.toml: not a TOML file"),
    (nothing, "train ref -o n.lvpr --config none.toml", "none.toml: cannot be read"),
    (unknown_setting, "train ref -o n.lvpr --config bad.toml", "bad.toml: network.neuron_count is not a setting"),
    (out_of_range, "train ref -o n.lvpr --config bad.toml", "bad.toml: learning.eta is -3.0, but must be in [0, 10]"),
    (
        overflowing,
        "train ref -o n.lvpr --config bad.toml",
        "does not fit 0..7; lower network.inhibition",
    ),
    (nothing, "train ref -o n.lvpr --preset paper --input onoff", "takes encoder.kind 'pixels', not 'onoff'"),
    (nothing, "train ref -o n.lvpr --preset paper --stretch 3 --epochs 1", "in one network; use --stretch 0"),
    (nothing, "train ref -o n.lvpr --preset paper --weight-bits 3", "weight_bits is not a setting"),
    (checkpoint, TRAIN.format("ref"), "n.lvpr.checkpoint: an interrupted training can go on from here; add --resume"),
    (checkpoint, TRAIN.format("ref") + " --resume", "n.lvpr.checkpoint: the checkpoint is damaged"),
    (nothing, TRAIN.format("ref") + " --resume", "n.lvpr.checkpoint: there is no checkpoint to resume from"),
    (nothing, "eval none.lvpr query", "none.lvpr: the model cannot be read (No such file or directory)"),
    (nothing, "eval ref query", "ref: holds no manifest.json, so it is no bundle; give a model file or a folder"),
    (damaged_model, "eval m.lvpr query", "m.lvpr: the model is damaged (checksum differs)"),
    (foreign_model, "eval m.npz query", "m.npz: is not a lava-vpr model"),
    (empty_model, "eval e.lvpr query", "e.lvpr: the file is empty"),
    (nothing, "eval m.lvpr none", "none: cannot be opened"),
    (one_more_query, "eval m.lvpr query", "query: has 7 queries, the references 6: nothing says which place"),
    (nothing, "eval m4.lvpr query --places 2:6", "--places 2:6 are partly places of the model and partly not"),
    (more_queries, "eval m.lvpr query --places 2:9", "--places 2:9 are 7 queries for 6 other places"),
    (more_queries, "eval m.lvpr query --places 6:9", "--places 6:9 are 3 queries for 6 other places"),
    (nothing, "train ref -o ref/img0.png", "ref/img0.png: is also an input, which would be replaced"),
    (good_list, "train list.txt -o list.txt", "list.txt: is also an input, which would be replaced"),
    (nothing, "train ref -o quick.toml --config quick.toml", "quick.toml: is also an input"),
    (nothing, "query m.lvpr query -o m.lvpr", "m.lvpr: is also an input, which would be replaced"),
    (nothing, "query m.lvpr query -o query/img3.png", "query/img3.png: is also an input"),
    (nothing, "eval m.lvpr query --json m.lvpr", "m.lvpr: is also an input, which would be replaced"),
    (conflicting_presets, "train ref -o n.lvpr --preset paper --config bad.toml", "give one of them"),
    (endless_theta, "train ref -o n.lvpr --config bad.toml", "learning.tau_theta_ms is inf"),
    (nothing, "train ref -o n.lvpr --neurons 100000 --stretch 1", "a model of 6 places and 600,000 neurons takes"),
    (nothing, "eval m.lvpr query --gt none.txt", "none.txt: "),
    (garbled_gt, "eval m.lvpr query --gt gt.txt", "gt.txt line 2: 'two' is no index"),
    (gt_of_nobody, "eval m.lvpr query --gt gt.json", "gt.json: "),
    (nothing, "eval m.lvpr query --gt quick.toml", "quick.toml: is no known type of ground truth"),
    (nothing, "eval m.lvpr query --positions a.csv b.csv --radius 5", "a.csv: "),
    (short_positions, "eval m.lvpr query --positions r.csv q.csv --radius 5", "q.csv: has 2 positions"),
    (nan_positions, "eval m.lvpr query --positions r.csv q.csv --radius 5", "q.csv line 3: y is 'nan'"),
    (nothing, "eval m.lvpr query --descriptors a.npy b.npy", "a.npy: cannot be read"),
    (nan_descriptors, "eval m.lvpr query --descriptors r.npy q.npy", "q.npy: row 0 holds NaN"),
    (few_descriptors, "eval m.lvpr query --descriptors r.npy q.npy", "r.npy: has 5 rows for 6 images"),
    (
        pickled_descriptors,
        "eval m.lvpr query --descriptors r.npy q.npy",
        "r.npy: is no array of numbers (but of pickled objects)",
    ),
    (nothing, "eval m.lvpr query --sequence 9", "sequence length 9 exceeds the 6 queries"),
    (nothing, "eval m.lvpr query --json no/such.json", "no/such.json: the folder no does not exist"),
    (file_in_the_way, "eval m.lvpr query --report out", "out: is a file; name a folder"),
    (nothing, "query m.lvpr none -o q.csv", "none: cannot be opened"),
    (nothing, "query m.lvpr query -o ref", "ref: is a folder; name a file"),
    (nothing, "query m.lvpr query -o q.csv --places 4:9", "query: has 6 images; places 4:9 go beyond"),
    (nothing, "query m.lvpr query -o q.csv --sequence 7", "query: has 6 images, fewer than --sequence 7"),
    (someone_elses_folder, "synth out", "out: holds something else (thesis.tex)"),
    (file_in_the_way, "synth out", "out: exists and is not a folder"),
    (someone_elses_folder, "demo --out out", "out: holds something else (thesis.tex)"),
]


@pytest.mark.parametrize(("prepare", "command", "message"), DATA, ids=[f"{p.__name__}: {c}" for p, c, _ in DATA])
def test_bad_data_is_told_in_one_line(prepare: Callable[[Path], None], command: str, message: str, here: Path) -> None:
    prepare(here)
    before = {p: p.read_bytes() for p in here.rglob("*") if p.is_file()}
    result = run(*command.split())
    assert result.exit_code == 1, result.output
    assert result.stdout == ""
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("lava-vpr: error: ")
    assert message in lines[0], lines[0]
    # Nothing that existed is lost, and nothing half-made is left.
    assert {p: p.read_bytes() for p in here.rglob("*") if p.is_file()} == before


USAGE = [
    ("", "Usage:"),
    ("learn ref", "No such command 'learn'"),
    ("train -o n.lvpr", "Missing argument 'REFERENCE...'"),
    ("train ref", "Missing option '-o'"),
    ("train ref -o n.lvpr --places 5", "'5' is not of the form A:B, for instance 0:100"),
    ("train ref -o n.lvpr --places 5:5", "'5:5' holds no place; A must be below B"),
    ("train ref -o n.lvpr --places -1:5", "'-1:5' is not of the form A:B"),
    ("train ref -o n.lvpr --seed -1", "-1 is not in the range"),
    ("train ref -o n.lvpr --seed x", "'x' is not a valid integer range"),
    ("train ref -o n.lvpr --weight-bits 9", "9 is not in the range 1<=x<=8"),
    ("train ref -o n.lvpr --epochs 0", "0 is not in the range"),
    ("train ref -o n.lvpr --preset quick", "'quick' is not one of 'loihi', 'balanced', 'fast', 'paper'"),
    ("train ref -o n.lvpr --input edges", "'edges' is not one of"),
    ("eval m.lvpr", "Missing argument 'QUERY'"),
    ("eval m.lvpr query --positions a.csv b.csv", "--positions needs --radius M"),
    ("eval m.lvpr query --radius 5", "--radius needs --positions"),
    ("eval m.lvpr query --radius -5 --positions a b", "-5.0 is not in the range x>=0"),
    ("eval m.lvpr query --radius nan --positions a b", "--radius is not a number"),
    ("eval m.lvpr query --radius inf --positions a b", "--radius is infinite"),
    ("fit --target loihi2 --neurons-per-place nan", "--neurons-per-place is not a number"),
    ("train ref -o n.lvpr --places 0:" + "9" * 5000, "is not of the form A:B"),
    ("eval m.lvpr query --gt a.txt --tolerance 2", "--tolerance counts places along the route"),
    ("eval m.lvpr query --sequence 0", "0 is not in the range x>=1"),
    ("eval m.lvpr query --backend gpu", "'gpu' is not one of 'host'"),
    ("verify m.lvpr", "Missing argument 'QUERY'"),
    ("verify m.lvpr query --limit 0", "0 is not in the range x>=1"),
    ("train ref -o n.lvpr --learning analog", "'analog' is not one of 'float', 'integer'"),
    ("query m.lvpr query -o q.csv --min-confidence nan", "--min-confidence is not a number"),
    ("query m.lvpr query -o q.csv --min-confidence high", "'high' is not a valid float"),
    ("synth out --places 1", "1 is not in the range"),
]


@pytest.mark.parametrize(("command", "message"), USAGE, ids=[c[:80] for c, _ in USAGE])
def test_wrong_usage_exits_with_2(command: str, message: str, here: Path) -> None:
    result = run(*command.split())
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.output.split()), result.output
    assert "Traceback" not in result.output
