"""`lava-vpr eval`: the files, tables and drawings that others script against; some of what `query` and `verify` say."""

from __future__ import annotations

import csv
import dataclasses
import json
import re
import shutil
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.commands import fails, figures, images, listed, matches, recall, run

from lava_vpr import __version__, model
from lava_vpr.backends.rivals import BASELINES
from lava_vpr.cli import main
from lava_vpr.cli.show.recall import MEANING

FIGURES = {"recall_at_1", "recall_at_n", "recall_at_100_precision", "precision_at_100_recall", "auc"}
DECODERS = ["standard", "weighted", "probability", "weighted_probability", "contrast"]


def test_the_json_has_these_keys_in_this_order(here: Path) -> None:
    values = figures("query")
    assert list(values) == [
        "model",
        "query",
        "version",
        "places",
        "queries",
        "network",
        "default_decoder",
        "decoders",
        "baselines",
        "adapted",
        "position_error",
        "followed",
        "probability",
        "curves",
    ]
    assert values["position_error"] is None
    assert values["adapted"] == {}
    assert list(values["followed"]) == ["filtered", "forward_backward"]
    assert list(values["probability"]) == ["single", "filtered"]
    (row, *_) = values["probability"]["single"]["thresholds"]
    assert list(row) == ["target", "probability", "accepted", "precision", "kept", "false_accepts"]
    assert list(values["curves"]) == ["decoders", "baselines", "adapted", "followed"]
    assert (values["places"], values["queries"], values["default_decoder"]) == (8, 8, "contrast")
    assert values["network"] == {"neurons": 8, "weight_bits": 3, "steps": 256}
    assert list(values["decoders"]) == DECODERS
    assert list(values["baselines"]) == ["sad", "cosine", "hog", "template"]
    for matcher in (*values["decoders"].values(), *values["baselines"].values()):
        assert set(matcher) == FIGURES
        assert set(matcher["recall_at_n"]) == {"5", "10"}
        numbers = [matcher[key] for key in FIGURES - {"recall_at_n"}] + list(matcher["recall_at_n"].values())
        assert all(isinstance(x, float) and 0 <= x <= 1 for x in numbers)
        assert matcher["recall_at_n"]["10"] == 1.0  # of 8 places
    assert recall(values) >= 0.75


def test_the_json_has_the_curve_of_every_figure(here: Path) -> None:
    values = figures("query", "--adapt", 4)
    for group, curves in values["curves"].items():
        assert list(curves) == list(values[group])
        for name, curve in curves.items():
            matcher, recalls, precisions = values[group][name], curve["recall"], curve["precision"]
            assert len(recalls) == len(precisions) == len(curve["threshold"])
            assert (recalls[0], precisions[0], curve["threshold"][0]) == (0.0, 1.0, None)
            falling = [threshold for threshold in curve["threshold"][1:] if threshold is not None]
            assert falling == sorted(falling, reverse=True)
            assert recalls[-1] == precisions[-1] == matcher["recall_at_1"]  # every query is answered
            sure = [recall for recall, precision in zip(recalls, precisions, strict=True) if precision == 1]
            assert max(sure) == matcher["recall_at_100_precision"]
            area = np.sum(np.diff(recalls) * (np.array(precisions[1:]) + precisions[:-1]) / 2)
            assert area == pytest.approx(matcher["auc"])


def test_thresholds_say_what_they_accept(here: Path) -> None:
    accepted = [row["accepted"] == "true" for row in matches("query", "--motion", "none", "--target-precision", 0.9)]
    (row, *_) = figures("query")["probability"]["single"]["thresholds"]
    assert row["target"] == 0.9
    assert row["accepted"] == sum(accepted) / len(accepted)


def test_equal_inputs_write_equal_bytes_wherever_they_are(here: Path) -> None:
    written = []
    for place in ("one", "another/deeper"):
        folder = here / place
        folder.mkdir(parents=True)
        shutil.copy("m.lvpr", folder / "m.lvpr")
        shutil.copytree("query", folder / "query")
        names = ("--json", folder / "f.json", "--report", folder / "r")
        table = run("eval", folder / "m.lvpr", folder / "query", *names).stdout
        files = [p for p in sorted(folder.rglob("*")) if p.is_file() and "query" not in p.parts]
        written.append({str(p.relative_to(folder)): p.read_bytes() for p in files})
        said = f"\\.\n{re.escape(MEANING)}\n8 queries, 8 places, 8 neurons\n"
        assert re.match(f"Recognised the place in [0-8] of 8 queries{said}", table)
    assert written[0] == written[1]
    assert {"f.json", "r/report.html"} <= set(written[0])
    text = written[0]["f.json"].decode() + written[0]["r/report.html"].decode()
    assert str(here) not in text
    assert "lava-vpr eval m.lvpr query" in written[0]["r/report.html"].decode()
    assert not re.search(r"\b20\d\d-\d\d-\d\d\b|\d\d:\d\d:\d\d", text)


def test_ground_truth_says_which_places_are_right(here: Path) -> None:
    plain = figures("query")
    Path("gt.txt").write_text("".join(f"{k}: {k}\n" for k in range(8)))
    assert figures("query", "--gt", "gt.txt") == plain
    assert (plain["model"], plain["version"], plain["query"]) == ("m.lvpr", __version__, "query")
    Path("wrong.json").write_text(json.dumps({str(k): (k + 4) % 8 for k in range(8)}))
    assert recall(figures("query", "--gt", "wrong.json")) == 0
    assert recall(figures("query", "--gt", "wrong.json", "--tolerance", 7)) == 1
    Path("any.json").write_text(json.dumps({str(k): list(range(8)) for k in range(8)}))
    assert recall(figures("query", "--gt", "any.json")) == 1


def test_fewer_and_more_queries_than_places(here: Path) -> None:
    Path("gt.txt").write_text("".join(f"{k}: {k}\n" for k in range(8)))
    few = figures("query", "--places", "5:8", "--gt", "gt.txt")
    assert (few["places"], few["queries"]) == (8, 3)
    assert recall(few) >= 2 / 3
    order = [3, 1, 3, 0, 7, 7, 6, 5, 4, 2, 1, 0]
    listed("more.txt", [images("query")[k] for k in order])
    np.save("gt.npy", np.array(order))
    more = figures("more.txt", "--gt", "gt.npy")
    assert (more["places"], more["queries"]) == (8, 12)
    assert recall(more) >= 0.75


def test_some_of_the_places(here: Path) -> None:
    """Queries that carry places' own numbers need no ground truth; others are taken in order, and that is said."""
    Path("gt.txt").write_text("".join(f"{k}: {k}\n" for k in range(8)))
    some = figures("query", "--places", "2:6")
    assert (some["places"], some["queries"]) == (8, 4)
    assert some == figures("query", "--places", "2:6", "--gt", "gt.txt")
    assert recall(some) >= 0.75
    run("train", "reference", "-o", "end.lvpr", "--config", "quick.toml", "--places", "4:8")
    listed("end.txt", images("query")[4:])
    words = ["eval", "end.lvpr", "end.txt", "--places", "0:4", "--json", "end.json"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0
    assert result.stderr == "note: images 0:4 are taken, in order, as the places 4:8\n"
    assert recall(json.loads(Path("end.json").read_text())) >= 0.75


def test_positions_and_radius(here: Path) -> None:
    positions = ("--positions", "reference_positions.csv", "query_positions.csv", "--radius")
    near = figures("query", *positions, 8)
    assert near.pop("position_error")["radius_m"] == 8
    assert {**near, "position_error": None} == figures("query")  # places are 20 m apart, known to 3 m
    assert recall(figures("query", *positions, 0)) == 0
    wide = figures("query", *positions, 1000)
    assert recall(wide) == recall(wide, "sad") == 1
    few = figures("query", "--places", "5:8", *positions, 8)
    assert (few["queries"], few["places"]) == (3, 8)


def test_tolerance_counts_neighbours(here: Path) -> None:
    listed("next.txt", images("query")[1:] + images("query")[:1])
    assert recall(figures("next.txt")) <= 0.25
    assert recall(figures("next.txt", "--tolerance", 1)) >= 0.75
    assert recall(figures("next.txt", "--tolerance", 7)) == 1


def test_sequences(here: Path) -> None:
    triple = figures("query", "--sequence", 3)
    assert list(triple["decoders"]) == DECODERS
    assert triple["queries"] == 8
    assert recall(triple) == 1
    # Only whole windows count: six of them, named after their first query. Half of the queries are truly here.
    Path("gt.json").write_text(json.dumps({str(k): k if k < 4 else [] for k in range(8)}))
    right = sum(int(row["place"]) == k for k, row in enumerate(matches("query")[:4]))
    assert recall(figures("query", "--gt", "gt.json")) == right / 8 >= 3 / 8
    assert recall(figures("query", "--gt", "gt.json", "--sequence", 3)) == 4 / 6
    assert "6 sequences of 3 queries, 8 places, 8 neurons" in run("eval", "m.lvpr", "query", "--sequence", 3).stdout


def test_one_baseline_only(here: Path) -> None:
    everything = figures("query")
    of_images = ["sad", "cosine", "hog", "template"]
    assert list(everything["baselines"]) == of_images
    assert {*BASELINES} - {*of_images} == {"vectors", "standardised"}
    for name in of_images:
        assert figures("query", "--baseline", name)["baselines"] == {name: everything["baselines"][name]}
    all_named = figures("query", *(word for name in of_images for word in ("--baseline", name)))
    assert all_named == everything


def test_a_model_of_before_hog_is_compared_with_what_it_keeps(here: Path) -> None:
    old = dataclasses.replace(model.load("m.lvpr"), hog=None)
    model.save(old, Path("old.lvpr"))
    done = run("eval", "old.lvpr", "query", "--json", "f.json")
    assert "no hog: the model keeps no HOG descriptors of its references; train it again" in done.stdout
    assert list(json.loads(Path("f.json").read_text())["baselines"]) == ["sad", "cosine", "template"]
    refused = fails("eval", "old.lvpr", "query", "--baseline", "hog")
    assert "baseline hog: the model keeps no HOG descriptors of its references; train it again" in refused


def test_descriptors_of_another_method(here: Path) -> None:
    np.save("r.npy", np.eye(8, dtype=np.float32))
    np.save("q.npy", np.roll(np.eye(8, dtype=np.float32), 1, axis=0))
    right = figures("query", "--descriptors", "r.npy", "r.npy")
    assert list(right["baselines"]) == ["sad", "cosine", "hog", "template", "descriptors"]
    assert recall(right, "descriptors") == 1
    assert recall(figures("query", "--descriptors", "r.npy", "q.npy"), "descriptors") == 0


def test_the_seed_of_queries_is_the_models_by_default(here: Path) -> None:
    run("train", "reference", "-o", "s5.lvpr", "--config", "quick.toml", "--seed", 5)
    answers = {}
    for name, options in {"default": (), "5": ("--seed", 5), "0": ("--seed", 0)}.items():
        run("query", "s5.lvpr", "query", "-o", f"{name}.csv", *options)
        run("eval", "s5.lvpr", "query", "--json", f"{name}.json", "--sequence", 2, *options)
        answers[name] = Path(f"{name}.csv").read_bytes(), Path(f"{name}.json").read_bytes()
    assert answers["default"] == answers["5"]
    assert answers["default"][0] != answers["0"][0]


def test_a_backend_that_was_named_and_could_not_run_is_a_failure(here: Path) -> None:
    """It is found out only when the network is shown to it; those that nobody named are merely told of."""
    Path("many.toml").write_text("[encoder]\nquery_spikes = 60.0\n[learning]\nepochs = 1\n")
    run("train", "reference", "--config", "many.toml", "-o", "many.lvpr")
    words = ["verify", "many.lvpr", "query", "--limit", "2", "--backend", "bundle", "--json", "v.json"]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 1
    assert "takes 56 a chip; lower encoder.query_spikes to" in " ".join(done.stdout.split())
    assert done.stderr.splitlines()[-1] == (
        "lava-vpr: error: bundle: was not compared; see above, or choose another --backend"
    )
    assert json.loads(Path("v.json").read_text())["backends"]["bundle"]["available"] is False


@pytest.mark.parametrize(
    ("name", "begins", "lines"),
    [
        ("t.csv", "matcher,R@1,", 0),
        ("t.md", "| matcher | R@1 |", 1),
        ("t.TEX", "\\begin{tabular}{lrrrrrr}\n\\hline\nmatcher & R@1 &", 5),
    ],
)
def test_the_table_as_a_file(here: Path, name: str, begins: str, lines: int) -> None:
    values = figures("query", "--table", name)
    text = Path(name).read_text()
    assert text.startswith(begins)
    assert text.endswith("\n")
    assert not text.endswith("\n\n")
    rules = text.count("\\hline") - 3 if lines == 5 else 0  # those between the groups
    rows = sum(len(values[group]) for group in ("decoders", "baselines", "adapted", "followed"))
    assert len(text.splitlines()) == 1 + lines + rules + rows
    assert "is named" in fails("eval", "m.lvpr", "query", "--table", name, "--json", name)
    assert "--table FILE must end in one of .csv, .md, .tex, not t.xls" in fails(
        "eval", "m.lvpr", "query", "--table", "t.xls", code=2
    )


def test_pages_draw_a_spiking_front_end_and_no_other(here: Path) -> None:
    """Of the surest match; of a model without, there is no such section."""
    run("train", "reference", "-o", "f.lvpr", "--input", "frontend", "--preset", "fast", "--learning", "template")
    for command, file in (("eval", "r/report.html"), ("query", "r/query.html")):
        run(command, "f.lvpr", "query", "--report", "r")
        page = Path(file).read_text()
        surest = re.search(r"when it is shown (\S+\.png), the surest match", page)
        assert surest is not None
        assert (Path("query") / surest[1]).exists()
        assert 'aria-label="Layers of the front end in 29 steps; spikes: ' in page
        run(command, "m.lvpr", "query", "--report", "plain")
        assert 'id="layers"' not in Path("plain", Path(file).name).read_text()


def test_the_drawings_as_files(here: Path) -> None:
    """They are those of the page, which is the same with them and without, in colours that need no page."""
    words = ("eval", "m.lvpr", "query", "--baseline", "template")
    told = run(*words, "--report", "r", "--figures", "figures").stdout
    assert told.endswith(f"report: {Path('r/report.html')}\nfigures: figures\n")
    page = Path("r/report.html").read_text()
    run(*words, "--report", "again")
    assert Path("again/report.html").read_text() == page
    drawn = {path.name: path.read_bytes() for path in Path("figures").iterdir()}
    prefixes = set(re.findall(r'<svg role="img".*?<g id="(\w+)-figure_1">', page, re.DOTALL))
    assert {"pr", "m0", "reliability"} <= prefixes
    assert set(drawn) == {f"{name}.{kind}" for name in prefixes for kind in ("svg", "pdf")}
    for name, content in drawn.items():
        if name.endswith("svg"):
            ElementTree.fromstring(content)
            assert not re.search(rb"var\(|#0[0-9a-f]e5f", content)
        else:
            assert content.startswith(b"%PDF-")
            assert b"CreationDate" not in content
    assert b">contrast</text>" in drawn["pr.svg"]
    assert "exists, and a folder of figures replaces nothing" in fails(
        "eval", "m.lvpr", "query", "--figures", "figures"
    )
    run(*words, "--figures", "alone")
    assert {path.name: path.read_bytes() for path in Path("alone").iterdir()} == drawn


def test_seeds_are_asked_one_by_one_and_shown_as_mean_and_range(here: Path) -> None:
    """Each seed's figures are those of --seed; what no noise changes stands as it is."""
    encoder, network = "query_spikes = 2.0", "trains = 'poisson'\nsteps = 16\nthreshold = 0.2"
    Path("n.toml").write_text(f"[encoder]\n{encoder}\n[network]\n{network}\n")
    run("train", "reference", "--config", "n.toml", "--epochs", 1, "-o", "s.lvpr")

    def figures_of(*words: object) -> dict[str, Any]:
        run("eval", "s.lvpr", "query", *words, "--json", "s.json")
        return dict(json.loads(Path("s.json").read_text()))

    several = figures_of("--seed", 4, "--seeds", 3, "--table", "t.csv")
    assert [one["seed"] for one in several["seeds"]] == [4, 5, 6]
    alone = [figures_of("--seed", seed, "--baseline", "template") for seed in (4, 5, 6)]
    for found, one in zip(several["seeds"], alone, strict=True):
        assert [found[key] for key in ("decoders", "followed")] == [one[key] for key in ("decoders", "followed")]
        assert found["baselines"]["template"] == one["baselines"]["template"]
    assert several["decoders"] == alone[0]["decoders"]
    said = run("eval", "s.lvpr", "query", "--seed", 4, "--seeds", 3).stdout
    first, *meaning = said.splitlines()[:4]
    assert re.fullmatch(r"Recognised the place in \d of 8 queries, with the first of 3 seeds\.", first)
    assert [line.partition(":")[0] for line in meaning] == ["R@1", "R@100P", "AUC"]
    assert said.count("R@100P:") == 1
    assert "\nR@5, R@10, P@100R, AUC and the other decoders: --report, --table or --json\n" in said
    rows = {row["matcher"]: row for row in csv.DictReader(Path("t.csv").read_text().splitlines())}
    areas = [100 * one["decoders"]["weighted"]["auc"] for one in alone]
    assert max(areas) > min(areas)
    assert rows["weighted"]["AUC"] == f"{np.mean(areas):.1f} ({min(areas):.1f} to {max(areas):.1f})"
    assert rows["cosine"]["AUC"] == f"{100 * several['baselines']['cosine']['auc']:.1f}"
