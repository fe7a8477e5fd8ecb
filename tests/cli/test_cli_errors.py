"""Ways to call the command line wrongly, or with files that cannot be used: each ends in one clear line."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.commands import SHORT, content, fails, matches
from support.common.imagefiles import blocky_picture, image_bytes, written

from lava_vpr.cli import main


def saved(save: Callable[..., None], array: np.ndarray) -> bytes:
    """The file that ``save`` of NumPy makes of an array."""
    buffer = io.BytesIO()
    save(buffer, array)
    return buffer.getvalue()


TRAIN = "train {} -o n.lvpr --config quick.toml"
DEPLOY = "deploy m.lvpr --target kapoho-bay -o c"
PICTURE = image_bytes(".png", blocky_picture(77))
DARK = image_bytes(".png", np.zeros((20, 30), np.uint8))
MORE = {f"query/img{k}.png": PICTURE for k in (6, 7, 8)}
SHORTER = {f"ref2/img{k}.png": PICTURE for k in range(5)}
DATA: list[tuple[dict[str, bytes | str | None], str, str]] = [
    ({}, "train none -o n.lvpr", "none: cannot be opened (No such file or directory)"),
    ({"empty/": ""}, "train empty -o n.lvpr", "empty: "),
    ({"texts/a.txt": "hello"}, "train texts -o n.lvpr", "texts: "),
    ({"ref/img3.png": PICTURE[:60]}, TRAIN.format("ref"), "img3.png: "),
    ({"query/img2.png": ""}, "eval m.lvpr query", "img2.png: "),
    ({"ref/img1.png": "I am no image"}, TRAIN.format("ref"), "img1.png: "),
    ({"ref/img2.tif": image_bytes(".tif", np.full((20, 30), np.nan, np.float32))}, TRAIN.format("ref"), "img2.tif: "),
    ({"dark/a.png": DARK, "dark/b.png": DARK}, TRAIN.format("dark"), "dark: no input responds to any reference: they"),
    ({"list.txt": "ref/img0.png\nref/none.png\n"}, TRAIN.format("list.txt"), "none.png"),
    ({"list.txt": "# nothing\n"}, TRAIN.format("list.txt"), "list.txt: "),
    ({"v.mp4": "not a video"}, TRAIN.format("v.mp4"), "v.mp4: "),
    ({}, TRAIN.format("quick.toml"), "quick.toml: is of no known type"),
    ({}, TRAIN.format("ref") + " --places 0:50", "ref: has 6 images; places 0:50 go beyond, use at most 0:6"),
    ({}, TRAIN.format("ref") + " --every 0", "--every is 0"),
    ({}, TRAIN.format("ref") + " --every nan", "--every is nan"),
    (
        {"one/img0.png": PICTURE},
        TRAIN.format("one"),
        "one: a route needs at least 2 places, but there is 1 image; give a folder",
    ),
    ({}, TRAIN.format("ref") + " --parts 3,4", "parts of 3, 4 places are 7 of a route of 6; give parts of at least 1"),
    ({}, TRAIN.format("ref") + " --places 2:3", "ref: a route needs at least 2 places, but there is 1 image"),
    (SHORTER, TRAIN.format("ref ref2"), "ref2: reference traverse 2 has 5 images, the first has 6"),
    ({}, "train ref -o no/such/n.lvpr", "no/such/n.lvpr: the folder no/such does not exist; create it first"),
    ({}, "train ref -o query", "query: is a folder; name a file"),
    ({"bad.toml": "[network\n"}, "train ref -o n.lvpr --config bad.toml", "bad.toml: not a TOML file"),
    ({}, "train ref -o n.lvpr --config none.toml", "none.toml: cannot be read"),
    (
        {"bad.toml": "[network]\nneuron_count = 3\n"},
        "train ref -o n.lvpr --config bad.toml",
        "bad.toml: network.neuron_count is not a setting",
    ),
    (
        {"bad.toml": "[learning]\neta = -3.0\n"},
        "train ref -o n.lvpr --config bad.toml",
        "bad.toml: learning.eta is -3.0, but must be in [0, 10]",
    ),
    (
        {"bad.toml": SHORT.replace("[network]\n", "[network]\nthreshold = 1.0\ninhibition = 9000.0\n")},
        "train ref -o n.lvpr --config bad.toml",
        "does not fit 0..7; lower network.inhibition",
    ),
    ({}, "train ref -o n.lvpr --preset paper --input onoff", "takes encoder.kind 'pixels', not 'onoff'"),
    ({}, "train ref -o n.lvpr --preset paper --stretch 3 --epochs 1", "in one network; use --stretch 0"),
    ({}, "train ref -o n.lvpr --preset paper --weight-bits 3", "weight_bits is not a setting"),
    (
        {"n.lvpr.checkpoint": "lava-vpr checkpoint 1\nrest"},
        TRAIN.format("ref"),
        "n.lvpr.checkpoint: an interrupted training can go on from here; add --resume",
    ),
    (
        {"n.lvpr.checkpoint": "lava-vpr checkpoint 1\nrest"},
        TRAIN.format("ref") + " --resume",
        "n.lvpr.checkpoint: the checkpoint is damaged",
    ),
    ({}, TRAIN.format("ref") + " --resume", "n.lvpr.checkpoint: there is no checkpoint to resume from"),
    ({}, "eval none.lvpr query", "none.lvpr: the model cannot be read (No such file or directory)"),
    (
        {},
        "eval ref query",
        "ref: holds no manifest.json, so it is no bundle; give a model file, which `lava-vpr train` makes",
    ),
    ({"m.lvpr": None}, "eval m.lvpr query", "m.lvpr: the model is damaged (checksum differs)"),
    ({"m.npz": saved(np.savez, np.zeros(3))}, "eval m.npz query", "m.npz: is not a lava-vpr model"),
    ({"e.lvpr": ""}, "eval e.lvpr query", "e.lvpr: the file is empty"),
    ({}, "eval m.lvpr none", "none: cannot be opened"),
    (
        {},
        "eval m.lvpr https://a.org/b",
        "https://a.org/b: nothing is fetched from a network; download it first",
    ),
    (
        {},
        "query http://a.org/m.lvpr query",
        "http://a.org/m.lvpr: nothing is fetched from a network; download it first",
    ),
    ({}, "query m.lvpr 0", "0: cannot be opened (No such file or directory); check the path; a camera is camera:0"),
    (
        {"query/img9.png": PICTURE},
        "eval m.lvpr query",
        "query: has 7 queries, the references 6: nothing says which place",
    ),
    (
        {"query/img9.png": PICTURE},
        "eval m.lvpr query",
        "then --query-positions FILE|exif; the command query needs none of these",
    ),
    ({}, "eval m4.lvpr query --places 2:6", "--places 2:6 are partly places of the model and partly not"),
    (MORE, "eval m.lvpr query --places 2:9", "--places 2:9 are 7 queries for 6 other places"),
    (MORE, "eval m.lvpr query --places 6:9", "--places 6:9 are 3 queries for 6 other places"),
    ({}, "train ref -o ref/img0.png", "ref/img0.png: is also an input, which would be replaced"),
    (
        {"list.txt": "ref/img0.png\nref/img1.png\n"},
        "train list.txt -o list.txt",
        "list.txt: is also an input, which would be replaced",
    ),
    ({}, "train ref -o quick.toml --config quick.toml", "quick.toml: is also an input"),
    ({}, "query m.lvpr query -o m.lvpr", "m.lvpr: is also an input, which would be replaced"),
    ({}, "eval m.lvpr query --json m.lvpr", "m.lvpr: is also an input, which would be replaced"),
    ({"bad.toml": "preset = 'loihi'\n"}, "train ref -o n.lvpr --preset paper --config bad.toml", "give one of them"),
    (
        {"bad.toml": "preset = 'paper'\n[learning]\ntau_theta_ms = inf\n"},
        "train ref -o n.lvpr --config bad.toml",
        "learning.tau_theta_ms is inf",
    ),
    ({}, "train ref -o n.lvpr --neurons 100000 --stretch 1", "a model of 6 places and 600,000 neurons takes"),
    ({}, "eval m.lvpr query --gt none.txt", "none.txt: "),
    ({"gt.txt": "0: 1\n1: two\n"}, "eval m.lvpr query --gt gt.txt", "gt.txt line 2: 'two' is no index"),
    ({"gt.json": '{"900": [1]}'}, "eval m.lvpr query --gt gt.json", "gt.json: "),
    ({}, "eval m.lvpr query --gt quick.toml", "quick.toml: is no known type of ground truth"),
    ({}, "eval m.lvpr query --positions a.csv b.csv --radius 5", "a.csv: "),
    ({"q.csv": "x,y\n0,0\n1,0\n"}, "eval m.lvpr query --positions xy.csv q.csv --radius 5", "q.csv: has 2 positions"),
    (
        {"q.csv": "x,y\n0,0\n1,nan\n2,0\n3,0\n4,0\n5,0\n"},
        "eval m.lvpr query --positions xy.csv q.csv --radius 5",
        "q.csv line 3: y is 'nan'",
    ),
    ({}, "eval m.lvpr query --descriptors a.npy b.npy", "a.npy: cannot be read"),
    (
        {"r.npy": saved(np.save, np.ones((6, 4))), "q.npy": saved(np.save, np.full((6, 4), np.nan))},
        "eval m.lvpr query --descriptors r.npy q.npy",
        "q.npy: row 0 holds NaN",
    ),
    (
        {"r.npy": saved(np.save, np.ones((5, 4))), "q.npy": saved(np.save, np.ones((6, 4)))},
        "eval m.lvpr query --descriptors r.npy q.npy",
        "r.npy: has 5 rows for 6 images",
    ),
    (
        {"r.npy": saved(np.save, np.array([{"a": 1}], dtype=object)), "q.npy": saved(np.save, np.ones((6, 4)))},
        "eval m.lvpr query --descriptors r.npy q.npy",
        "r.npy: is no array of numbers (but of pickled objects)",
    ),
    ({}, "eval m.lvpr query --sequence 9", "sequence length 9 exceeds the 6 queries"),
    ({}, "eval m.lvpr query --json no/such.json", "no/such.json: the folder no does not exist"),
    ({"out": "a file"}, "eval m.lvpr query --report out", "out: is a file; name a folder"),
    ({}, "query m.lvpr none -o q.csv", "none: cannot be opened"),
    ({}, "query m.lvpr query -o ref", "ref: is a folder; name a file"),
    ({}, "query m.lvpr query -o q.csv --places 4:9", "query: has 6 images; places 4:9 go beyond"),
    ({}, "query m.lvpr query -o q.csv --sequence 7", "query: has 6 images, fewer than --sequence 7"),
    ({"out/thesis.tex": "years of work"}, "synth out", "out: holds something else (thesis.tex)"),
    ({"out": "a file"}, "synth out", "out: exists and is not a folder"),
    ({"out/thesis.tex": "years of work"}, "demo --out out", "out: holds something else (thesis.tex)"),
    ({}, "bench none.lvpr query", "none.lvpr: the model cannot be read"),
    ({"m.lvpr": None}, "bench m.lvpr query", "m.lvpr: "),
    ({"b/host/responses.npy": "other"}, "bench b query", "host/responses.npy"),
    ({"none/": ""}, "bench m.lvpr none", "none: "),
    ({}, "bench m.lvpr query --places 4:99", "query: has 6 images; places 4:99 go beyond"),
    ({}, "bench m.lvpr query --json m.lvpr", "m.lvpr: is also an input"),
    ({}, "bench m.lvpr query --json query/img1.png", "img1.png: is also an input"),
    ({}, "bench m.lvpr query --json no/b.json", "no/b.json: the folder no does not exist"),
    ({"r": "a file"}, "bench m.lvpr query --report r", "r: is a file; name a folder"),
    ({}, "bench m.lvpr query --backend kapoho-bay", "NxSDK"),
    ({}, "fit none.lvpr --target loihi2", "none.lvpr: the model cannot be read (No such file or directory)"),
    ({}, "fit m.lvpr --target loihi2 --json m.lvpr", "m.lvpr: is also an input, which would be replaced"),
    ({}, "fit m.lvpr --target loihi2 --picture no/p.svg", "no/p.svg: the folder no does not exist"),
    ({}, f"{DEPLOY}/d", "c/d: the folder "),
    ({"c/thesis.tex": "years of work"}, DEPLOY, "c: "),
    ({"c": "a file"}, DEPLOY, "c: is no folder, and a bundle is one"),
    ({}, f"{DEPLOY} --weight-bits 8", "network.weight_bits is 8, but must be in [1, 7]"),
    ({}, f"{DEPLOY} --calibrate none", "none: cannot be opened"),
    ({}, f"{DEPLOY} --calibrate query --places 4:99", "query: has 6 images; places 4:99 go beyond"),
    ({}, f"{DEPLOY} --calibrate query --weight-bits 8 --max-loss 0.1", "network.weight_bits is 8, but must be"),
    ({}, f"{DEPLOY} --calibrate query --json query/img1.png", "img1.png: is also an input"),
]
"""Files that are written first (None: cut to the half), the command, and what it says."""


@pytest.mark.parametrize(("files", "command", "message"), DATA)
def test_bad_data_is_told_in_one_line(
    files: dict[str, bytes | str | None], command: str, message: str, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise RuntimeError("work was done before the error was found")

    monkeypatch.setattr("lava_vpr.bench.run.recall_and_costs", never)
    for name, text in files.items():
        if name.endswith("/"):
            Path(name).mkdir()
            continue
        data = Path(name).read_bytes() if text is None else text.encode() if isinstance(text, str) else text
        written(Path(name), data[: len(data) // 2] if text is None else data)
    before = content(place)
    assert message.lower() in fails(*command.split()).lower()
    assert content(place) == before  # nothing that existed is lost, and nothing half-made is left


USAGE = [
    ("", "Usage:"),
    ("learn ref", "No such command 'learn'"),
    ("trian ref", "No such command 'trian'. Did you mean 'train'?"),
    (
        "query m.lvpr query --target-precision 95",
        "95.0 is not in the range 0.01<=x<=0.9999. (as a share, 95 % is 0.95)",
    ),
    ("train -o n.lvpr", "Missing argument 'REFERENCE...'"),
    ("train ref", "Missing option '-o'"),
    ("train ref -o n.lvpr --places 5", "'5' is not of the form A:B, for instance 0:100"),
    ("train ref -o n.lvpr --places 5:5", "'5:5' holds no place; A must be below B"),
    ("train ref -o n.lvpr --places -1:5", "'-1:5' is not of the form A:B"),
    ("train ref -o n.lvpr --seed -1", "-1 is not in the range"),
    ("train ref -o n.lvpr --seed x", "'x' is not a valid integer range"),
    ("train ref -o n.lvpr --weight-bits 9", "9 is not in the range 1<=x<=8"),
    ("train ref -o n.lvpr --epochs 0", "0 is not in the range"),
    ("train ref -o n.lvpr --preset quick", "'quick' is not one of 'loihi', 'balanced', 'fast', 'accurate', 'paper'"),
    ("train ref -o n.lvpr --input edges", "'edges' is not one of"),
    ("eval m.lvpr", "Missing argument 'QUERY'"),
    ("eval m.lvpr query --positions a.csv b.csv", "--positions needs --radius M"),
    ("eval m.lvpr query --radius 5", "--radius needs --positions"),
    ("eval m.lvpr query --radius -5 --positions a b", "-5.0 is not in the range x>=0"),
    ("eval m.lvpr query --radius nan --positions a b", "--radius is not a number"),
    ("eval m.lvpr query --radius inf --positions a b", "--radius is infinite"),
    ("fit --target loihi2 --neurons-per-place nan", "--neurons-per-place is not a number"),
    ("train ref -o n.lvpr --places 0:" + "9" * 5000, "is not of the form A:B"),
    ("eval m.lvpr query --positions a b --radius 1 --tolerance 2", "--tolerance counts places along the route"),
    ("eval m.lvpr query --sequence 0", "0 is not in the range x>=1"),
    ("eval m.lvpr query --backend gpu", "'gpu' is not one of 'host'"),
    ("verify m.lvpr", "Missing argument 'QUERY'"),
    ("verify m.lvpr query --limit 0", "0 is not in the range x>=1"),
    ("train ref -o n.lvpr --learning analog", "'analog' is not one of 'float', 'integer'"),
    ("query m.lvpr query -o q.csv --min-confidence nan", "--min-confidence is not a number"),
    ("query m.lvpr query -o q.csv --min-confidence high", "'high' is not a valid float"),
    ("synth out --places 1", "1 is not in the range"),
    ("bench m.lvpr", "Missing argument 'QUERY'"),
    ("bench m.lvpr query --target loihi1", "'loihi1' is not one of"),
    ("bench m.lvpr query --backend cpu", "'cpu' is not one of"),
    ("bench m.lvpr query --limit 0", "0 is not in the range x>=1"),
    ("bench m.lvpr query --places 4:2", "holds no place"),
    ("fit m.lvpr", "Missing option '--target'"),
    ("fit m.lvpr --target loihi1", "'loihi1' is not one of 'kapoho-bay', 'loihi2'"),
    ("fit m.lvpr --target loihi2 --neurons-per-place 2", "--neurons-per-place is for fit without MODEL"),
    ("fit m.lvpr --target loihi2 --views 3", "--views is for fit without MODEL"),
    ("fit --target loihi2 --picture p.svg", "--picture draws the cores of a model; give MODEL"),
    ("fit --target loihi2 --weight-bits 9", "9 is not in the range 1<=x<=8"),
    ("fit --target loihi2 --input-mode spikes", "'spikes' is not one of 'injected', 'bias'"),
    ("deploy m.lvpr --target loihi2", "Missing option '-o'"),
    ("deploy m.lvpr -o c", "Missing option '--target'"),
    ("deploy m.lvpr --target loihi2 -o c --max-loss 0.1", "--max-loss needs --calibrate QUERY"),
    ("deploy m.lvpr --target loihi2 -o c --places 0:4", "--places chooses among the images of --calibrate QUERY"),
    ("deploy m.lvpr --target kapoho-bay -o c --learning", "--learning needs --target loihi2: the network that learns"),
    ("deploy m.lvpr --target loihi2 -o c --prune 1", "1.0 is not in the range 0<=x<1"),
    ("deploy m.lvpr --target loihi2 -o c --calibrate query --max-loss 2", "2.0 is not in the range 0<=x<=1"),
    ("deploy m.lvpr --target loihi2 -o c --prune nan", "--prune is not a number"),
    ("deploy m.lvpr --target loihi2 -o c --calibrate query --max-loss nan", "--max-loss is not a number"),
    ("deploy m.lvpr --target loihi2 -o c --dense-rows", "--dense-rows needs --target kapoho-bay: how Loihi 2 stores"),
    ("fit m.lvpr --target loihi2 --dense-rows", "--dense-rows needs --target kapoho-bay: how Loihi 2 stores"),
    ("fit --target kapoho-bay --dense-rows", "--dense-rows is for a MODEL"),
    ("query m.lvpr query --bag out", "--bag has the covariance of what is believed; give --motion any or forward"),
    ("export m.lvpr -o n.nir --time-step 0", "Invalid value for '--time-step'"),
    ("watch m.lvpr query --page x", "'x' is no port (0 to 65535); put --page behind MODEL and SOURCE"),
    ("watch m.lvpr query --page 65536", "'65536' is no port"),
    ("remove m.lvpr a", "'a' is neither an index nor a range A:B"),
    ("remove m.lvpr 3:2", "'3:2' holds no place"),
    ("remove m.lvpr 1,", "'' is neither an index nor a range A:B"),
    ("merge m.lvpr -o x.lvpr", "there is nothing to merge"),
    ("merge m.lvpr m.lvpr", "Missing option '-o'"),
    ("train ref -o n.lvpr --parts 3,x", "'3,x' are no numbers of at least 1"),
    ("train ref -o n.lvpr --parts 0,6", "'0,6' are no numbers of at least 1"),
]


@pytest.mark.parametrize(("command", "message"), USAGE, ids=[command[:80] for command, _ in USAGE])
def test_wrong_usage_exits_with_2(command: str, message: str, place: Path) -> None:
    before = content(place)
    assert message in " ".join(fails(*command.split(), code=2).split())
    assert content(place) == before


def test_a_pattern_of_images_is_no_list_of_traverses(here: Path) -> None:
    images = sorted(Path("reference").iterdir())
    text = fails("train", *images, "-o", "new.lvpr", "--config", "quick.toml")
    assert text == (
        f"{images[0]}: is one of 8 references, but a single image; give the folder reference instead "
        "of the images in it, or a list of them"
    )
    fails("train", "reference", images[0], "-o", "new.lvpr", "--config", "quick.toml")
    assert not Path("new.lvpr").exists()


@pytest.mark.parametrize("command", ["query", "eval", "bench", "verify"])
def test_a_pattern_of_query_images_is_told_to_be_their_folder(here: Path, command: str) -> None:
    images = sorted(map(str, Path("query").iterdir()))
    output = ["-o", "q.csv"] if command == "query" else []
    result = CliRunner().invoke(main, [command, "m.lvpr", *images, *output])
    assert result.exit_code == 2
    why = (
        f"Error: unexpected argument {images[1]!r} (7 too many); give the folder instead of the images in it, or a list"
    )
    assert why in result.stderr, result.stderr


def test_names_that_hold_line_ends_come_back_from_the_answers(here: Path) -> None:
    names = ["a\rb.png", "a\nb.png", "a\r\nb.png"]
    Path("odd").mkdir()
    for name in names:
        os.symlink(Path("query/place_00000.png").resolve(), Path("odd") / name)
    assert {row["query_name"] for row in matches("odd")} == set(names)
