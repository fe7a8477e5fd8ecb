"""``lava-vpr extend``, ``remove`` and ``merge``: what is written, where, and what is refused."""

from __future__ import annotations

import os
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from support.common import children
from support.common.commands import PLACES, fails, images, listed, run
from support.common.small_models import paper_model

from lava_vpr import model
from lava_vpr.model import save
from lava_vpr.storage.writing import only_one

SETTINGS = ("--config", "quick.toml", "--stretch", 3, "--jobs", 2)


def train(output: str, source: str, *words: object) -> None:
    run("train", source, "-o", output, *SETTINGS, *words)


def data(path: str) -> bytes:
    return Path(path).read_bytes()


def test_extend_merge_and_train_write_the_same_file(here: Path) -> None:
    """Of one folder; of two with as many images as a list of both; in place and elsewhere."""
    train("whole.lvpr", "reference", "--parts", "5,3")
    train("first.lvpr", "reference", "--places", "0:5")
    train("second.lvpr", "reference", "--places", "5:8")
    before = data("first.lvpr")
    said = run("extend", "first.lvpr", "reference", "--places", "5:8", "-o", "more.lvpr").stdout
    assert said.startswith("learned 3 places more, 5:8, in ")
    assert ": 8 places in 3 stretches, 8 neurons, 3-bit weights, " in said
    assert said.endswith("every place has a neuron\nmodel: more.lvpr\n")
    said = run("merge", "first.lvpr", "second.lvpr", "-o", "merged.lvpr").stdout
    assert said.startswith("merged 2 models: 8 places in 3 stretches, 8 neurons, ")
    assert data("first.lvpr") == before
    run("extend", "first.lvpr", "reference", "--places", "5:8", "--jobs", 1)
    assert data("more.lvpr") == data("merged.lvpr") == data("first.lvpr") == data("whole.lvpr") != before
    two, queries = images("reference"), images("query")
    train("a.lvpr", listed("a.txt", two))
    said = run("extend", "a.lvpr", "query", "--places", "0:2").stdout
    assert said.startswith("learned 2 places more, 8:10, in ")
    train("b.lvpr", listed("b.txt", [*two, *queries]), "--places", "0:10", "--parts", "8,2")
    assert data("a.lvpr") == data("b.lvpr")


def test_several_traverses_and_views(here: Path) -> None:
    words = ("reference", "query", "--views", 3, "--epochs", 1)
    train("whole.lvpr", *words, "--parts", "6,2")  # type: ignore[arg-type]
    train("first.lvpr", *words, "--places", "0:6")  # type: ignore[arg-type]
    told = fails("extend", "first.lvpr", "reference", "--places", "6:8")
    assert told.startswith("first.lvpr: the model was learned from 2 traverses, but the new places are shown in 1 trav")
    run("extend", "first.lvpr", "reference", "query", "--places", "6:8")
    assert data("first.lvpr") == data("whole.lvpr")


def test_positions_go_with_the_places(here: Path) -> None:
    """A map knows where all its places are, or none."""
    told = ("--positions", "reference_positions.csv")
    train("whole.lvpr", "reference", "--parts", "5,3", *told)
    train("first.lvpr", "reference", "--places", "0:5", *told)
    more = ("reference", "--places", "5:8")
    line = fails("extend", "first.lvpr", *more)
    assert line.startswith(
        "first.lvpr: the model knows where its places are, but nothing tells where those of reference"
    )
    run("extend", "first.lvpr", *more, *told)
    assert data("first.lvpr") == data("whole.lvpr")
    line = fails("extend", "m.lvpr", "query", "--positions", "query_positions.csv")
    assert line.startswith("m.lvpr: the model does not know where its places are; leave out --positions, or train it")
    run("remove", "first.lvpr", "2")
    where, all_of = model.load("first.lvpr").positions, model.load("whole.lvpr").positions
    assert where is not None
    assert all_of is not None
    np.testing.assert_array_equal(where, np.delete(all_of, 2, axis=0))


def test_remove_and_ask(here: Path) -> None:
    """Removed places are not answered, and eval asks for the others by their own indices."""
    said = run("remove", "m.lvpr", "1,4:6", "-o", "less.lvpr").stdout
    assert said.startswith("removed 3 places with 3 neurons: 5 places in 1 stretch, 5 neurons, ")
    assert model.load("less.lvpr").place_indices.tolist() == [0, 2, 3, 6, 7]
    run("eval", "less.lvpr", "reference", "--json", "f.json")
    assert '"queries": 5' in Path("f.json").read_text()
    assert '"recall_at_1": 1.0' in Path("f.json").read_text()
    left = run("eval", "less.lvpr", "reference", "--places", "1:7", "--json", "f.json").stderr
    assert "3 of 6 images are left out, since the map has no places of their numbers: 1:2, 4:6\n" in left
    assert '"queries": 3' in Path("f.json").read_text()
    shutil.copy("less.lvpr", "in_place.lvpr")
    assert run("remove", "in_place.lvpr", "0").stdout.startswith("removed 1 place with 1 neuron: 4 places in 1 str")
    assert model.load("in_place.lvpr").places == 4
    Path("some.txt").write_text("".join(f"{path}\n" for path in sorted(Path("query").iterdir())[:5]))
    said = fails("eval", "less.lvpr", "some.txt")
    assert "has 5 queries, the references 8 (places of the map: 5): nothing says which place a query shows" in said


def test_a_changed_map_is_deployed_and_verified(here: Path) -> None:
    """The bundle of an extended model has the same spikes as the host, and so has one that lost places."""
    run("extend", "m.lvpr", "query", "--places", "0:4", "-o", "more.lvpr")
    run("remove", "more.lvpr", "2,9", "-o", "less.lvpr")
    for name, places, target in (("more", 12, "kapoho-bay"), ("less", 10, "loihi2")):
        run("deploy", f"{name}.lvpr", "--target", target, "-o", target)
        said = run("verify", target, "reference", "--backend", "bundle", "--places", "0:2", "--json", "v.json")
        assert '"equal": true' in data("v.json").decode(), said.stdout
        run("query", target, "query", "-o", "bundle.csv", "--backend", "bundle")
        run("query", f"{name}.lvpr", "query", "-o", "host.csv")
        assert data("bundle.csv") == data("host.csv")
        assert len(data("host.csv").splitlines()) == PLACES + 1
        line = fails("extend", target, "query")
        assert line.startswith(f"{target}: is a folder; a bundle does not hold what the network has learned: use the")
        assert fails("merge", "m.lvpr", target, "-o", "x.lvpr") == fails("remove", target, "1") == line
        assert model.load(f"{name}.lvpr").places == places


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("extend", "gone.lvpr", "query"), "gone.lvpr: "),
        (("extend", "m.lvpr", "gone"), "gone: cannot be opened"),
        (("extend", "m.lvpr", "query", "--places", "5:9"), "query: has 8 images; places 5:9 go beyond"),
        (("extend", "m.lvpr", "query", "-o", "gone/x.lvpr"), "gone/x.lvpr: the folder gone does not exist"),
        (("extend", "m.lvpr", "query", "-o", "query"), "query: is a folder; name a file"),
        (("extend", "quick.toml", "query"), "quick.toml: "),
        (("remove", "m.lvpr", "8"), "m.lvpr: the model has no place 8; its places are 0:8"),
        (("remove", "m.lvpr", "5:999999999999999999"), "m.lvpr: the model has no place 8; its places are 0:8"),
        (("remove", "m.lvpr", "0:7"), "of 8 places 1 would be left"),
        (("merge", "m.lvpr", "m.lvpr", "-o", "m.lvpr"), "m.lvpr: is also an input, which would be replaced"),
        (
            ("merge", "m.lvpr", "seed.lvpr", "-o", "x.lvpr"),
            "seed.lvpr: the model was trained with seed 3, the first with",
        ),
        (
            ("merge", "m.lvpr", "paper.lvpr", "-o", "x.lvpr"),
            "paper.lvpr: merging needs stretches that learn by themselv",
        ),
        (("extend", "paper.lvpr", "query"), "paper.lvpr: extending needs stretches that learn by themselves, but pres"),
    ],
)
def test_what_cannot_be_is_refused(words: tuple[str, ...], text: str, here: Path) -> None:
    if "seed.lvpr" in words:
        run("train", "reference", "-o", "seed.lvpr", "--config", "quick.toml", "--seed", 3)
    if "paper.lvpr" in words:
        Path("p.toml").write_text('preset = "paper"\n[network]\nneurons = 6\nsteps = 40\nrest_steps = 5\n')
        run("train", "reference", "-o", "paper.lvpr", "--config", "p.toml", "--epochs", 1)
    before = sorted(os.listdir("."))
    line = fails(*words)
    assert text in line
    assert line.startswith(text) or line.startswith("of ")
    assert sorted(os.listdir(".")) == before


def test_two_at_once_and_read_only(here: Path) -> None:
    """Nobody writes what another holds, and who took the permission away meant it."""
    shutil.copy("m.lvpr", "own.lvpr")
    with only_one(Path("own.lvpr")):
        assert fails("remove", "own.lvpr", "1").startswith("own.lvpr: another training is writing it")
    Path("own.lvpr").chmod(0o444)
    assert fails("extend", "own.lvpr", "query").startswith("own.lvpr: cannot be written")
    assert data("own.lvpr") == data("m.lvpr")


KILLED = """
import os, signal
from lava_vpr.cli import main
os.fsync = lambda handle: os.kill(os.getpid(), signal.SIGKILL)
main(prog_name="lava-vpr")
"""


def test_killed_while_it_writes(here: Path) -> None:
    """The model is as it was, and the next extension takes its place."""
    shutil.copy("m.lvpr", "own.lvpr")
    words = ["extend", "own.lvpr", "query", "--places", "0:2"]
    ended = children.run([sys.executable, "-c", KILLED, *words], capture_output=True, check=False)
    assert ended.returncode == -signal.SIGKILL
    assert data("own.lvpr") == data("m.lvpr")
    run(*words)
    own, before = model.load("own.lvpr"), model.load("m.lvpr")
    np.testing.assert_array_equal(own.learned[:, : before.neurons], before.learned)
    assert own.places == before.places + 2


def test_there_and_back(here: Path) -> None:
    result = run("export", "m.lvpr", "-o", "net.nir")
    assert result.stdout == "2048 inputs, 8 excitatory and 1 inhibitory neurons, with references\nnir: net.nir\n"
    assert result.stderr.count("note: NIR ") == 2
    said = run("import", "net.nir", "-o", "again.lvpr")
    assert said.stdout.startswith("imported 8 places: 8 neurons, 3-bit weights, ")
    assert said.stderr == ""
    assert (here / "again.lvpr").read_bytes() == (here / "m.lvpr").read_bytes()


def test_the_network_alone_answers_like_the_model_that_lends_it_references(here: Path) -> None:
    run("export", "m.lvpr", "-o", "net.h5", "--format", "nir", "--no-references", "--time-step", 0.001)
    assert "give --like MODEL" in fails("import", "net.h5", "-o", "b.lvpr", "--format", "nir")
    run("train", "reference", "-o", "other.lvpr", "--config", "quick.toml", "--learning", "template")
    said = run("import", "net.h5", "-o", "b.lvpr", "--format", "nir", "--like", "other.lvpr")
    assert said.stderr == (
        "note: responses and calibration are measured again on the references; float weights as learned are not kept\n"
    )
    run("export", "b.lvpr", "-o", "b.nir")
    run("import", "b.nir", "-o", "c.lvpr")
    assert (here / "b.lvpr").read_bytes() == (here / "c.lvpr").read_bytes()
    run("query", "b.lvpr", "query", "-o", "b.csv")
    run("query", "m.lvpr", "query", "-o", "m.csv")
    answers = [[line.split(",")[2] for line in Path(name).read_text().splitlines()] for name in ("b.csv", "m.csv")]
    assert answers[0] == answers[1]


def test_a_bundle_is_exported_too(here: Path) -> None:
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "bundle")
    run("export", "bundle", "-o", "net.nir")
    run("import", "net.nir", "-o", "again.lvpr")
    run("query", "again.lvpr", "query", "-o", "a.csv")
    run("query", "m.lvpr", "query", "-o", "b.csv")
    assert (here / "a.csv").read_bytes() == (here / "b.csv").read_bytes()


def test_what_cannot_be_is_refused_before_any_work(here: Path) -> None:
    assert fails("export", "m.lvpr", "-o", "net.xyz").startswith("net.xyz: no format has names that end so; name it ")
    assert fails("import", "quick.toml", "-o", "n.lvpr", "--format", "nir") == (
        "quick.toml: is no HDF5 file, which a NIR graph is; give the right file"
    )
    assert fails("import", "none.nir", "-o", "n.lvpr").startswith("none.nir: the NIR graph cannot be read (No such")
    assert "is also an input" in fails("export", "m.lvpr", "-o", "m.lvpr", "--format", "nir")
    save(paper_model(4), here / "p.lvpr")
    assert fails("export", "p.lvpr", "-o", "p.nir").startswith("p.lvpr: format nir needs an integer network, but")
    assert not (here / "p.nir").exists()
