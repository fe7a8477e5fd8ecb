"""``lava-vpr study``: a table, JSON and a page of the same bytes every time; what is refused, in one line."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner
from support.common.commands import images, listed, run
from support.common.daskcluster import DaskCluster

from lava_vpr.cli import main
from lava_vpr.experiments.rows import Outcome, rows
from lava_vpr.experiments.task import MODELLED, NETWORK, Costs
from lava_vpr.matching.evaluation import Recall
from lava_vpr.studies.show import plots

QUICK = ("--config", "quick.toml", "--seeds", "0,1")


def study(*words: object) -> str:
    return run("study", *words, *QUICK).stdout


def fails(*words: object) -> str:
    """The only line that a command says which must fail because of its data."""
    result = CliRunner().invoke(main, ["study", *(str(word) for word in words)])
    assert result.exit_code == 1, result.output
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    return line


@pytest.mark.slow
def test_a_cluster_gives_the_bytes_of_this_machine(here: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    cluster = DaskCluster(tmp_path_factory.mktemp("cluster"))
    words = ("hyperactive", "reference", "--query", "query", "--values", "4")
    try:
        there = study(*words, "--cluster", cluster.address, "--json", "there.json", "--report", "there")
    finally:
        cluster.end()
    alone = study(*words, "--json", "here.json", "--report", "here")
    assert alone == there.replace("report: there", "report: here")
    assert Path("there.json").read_bytes() == Path("here.json").read_bytes()
    assert Path("there/study.html").read_bytes() == Path("here/study.html").read_bytes()


def test_places_take_a_part_of_each_traverse(here: Path) -> None:
    order = listed("part.txt", images("reference")[2:6])
    asked = listed("asked.txt", images("query")[2:6])
    whole = study("seeds", "reference", "--query", "query", "--places", "2:6", "--json", "a.json")
    study("seeds", order, "--query", asked, "--json", "b.json")
    assert Path("a.json").read_bytes() == Path("b.json").read_bytes()
    assert "4 queries, 4 places" in whole


def test_several_traverses_are_learned_together(here: Path) -> None:
    study("weighting", "reference", "query", "--query", "query", "--json", "w.json")
    points = json.loads(Path("w.json").read_text())["points"]
    assert {point["point"]: point["network"]["recall_at_1"]["mean"] for point in points}["decoder contrast"] == 1.0


REFUSED = [
    (("bits", "reference", "--query", "none"), "none: cannot be opened"),
    (("bits", "reference", "--query", "one.txt"), "one.txt: has 1 images for 8 places; image i of the query must show"),
    (("bits", "reference", "--query", "query", "--places", "0:1"), "reference: a route needs at least 2 places"),
    (("bits", "reference", "--query", "query", "--values", "9"), "network.weight_bits is 9"),
    (("seeds", "reference", "--query", "query", "--values", "9"), "the study seeds takes no --values"),
    (("bits", "reference", "--query", "query", "--preset", "paper"), "the study bits needs an integer network"),
    (("bits", "reference", "--query", "query", "--json", "no/f.json"), "no/f.json: the folder no does not exist"),
    (("bits", "reference", "--query", "query", "--cluster", "here"), "--cluster takes tcp://HOST:PORT, not 'here'"),
    (("bits", "reference", "--query", "query", "--config", "no.toml"), "no.toml: cannot be read"),
    (("bits", "reference", "--query", "query", "--json", "quick.toml", *QUICK), "quick.toml: is also an input"),
]


@pytest.mark.parametrize(("words", "said"), REFUSED)
def test_what_cannot_be_is_one_line(words: tuple[str, ...], said: str, here: Path) -> None:
    listed("one.txt", images("query")[:1])
    assert fails(*words).startswith(f"lava-vpr: error: {said}")
    assert not Path("study.html").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("more", "reference", "--query", "query"), "'more' is not one of 'places', 'neurons'"),
        (("bits", "reference"), "Missing option '--query'"),
        (("bits", "reference", "--query", "query", "--seeds", "0,0"), "--seeds names a seed twice"),
        (("bits", "reference", "--query", "query", "--seeds", "x"), "'x' are no numbers of at least 0"),
        (("bits", "reference", "--query", "query", "--values", "2,nan"), "'2,nan' are no numbers above 0"),
        (("bits", "reference", "--query", "query", "--values", "2,2"), "'2,2' names a number twice"),
    ],
)
def test_wrong_usage_is_said(words: tuple[str, ...], said: str, here: Path) -> None:
    result = CliRunner().invoke(main, ["study", *words])
    assert result.exit_code == 2
    assert said in result.stderr


@pytest.mark.parametrize("draw", [plots.curve, plots.costs])
@pytest.mark.parametrize("recall", [(1.0, 1.0), (0.62, 1.0), (0.97, 0.99)])
def test_no_axis_of_recall_goes_on_beyond_all(draw: Callable[..., str], recall: tuple[float, ...]) -> None:
    found = rows(
        Outcome(
            f"{k}",
            k,
            0,
            {NETWORK: dict.fromkeys(Recall._fields, value), MODELLED: Costs(k / 8, k / 16)._asdict()},
        )
        for k, value in enumerate(recall, start=2)
    )
    ticks = [float(text) for text in re.findall(r">(\d+(?:\.\d+)?)<", draw(found, "bits", "label"))]
    assert max(ticks) == 100
    assert sum(tick <= 100 for tick in ticks if tick >= 90) >= 2
