"""``lava-vpr export`` and ``lava-vpr import``: what they write, what they print, and what is refused."""

from __future__ import annotations

from pathlib import Path

from support.common.commands import fails, run
from support.common.small_models import paper_model

from lava_vpr.model import save


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
        "note: responses and calibration are measured anew on the references; float weights as learned are not kept\n"
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
    assert "Invalid value for '--time-step'" in fails("export", "m.lvpr", "-o", "n.nir", "--time-step", 0, code=2)
    save(paper_model(4), here / "p.lvpr")
    assert fails("export", "p.lvpr", "-o", "p.nir").startswith("p.lvpr: format nir needs an integer network, but")
    assert not (here / "p.nir").exists()
