"""The paper's table on drawn images in all official layouts, with sections of four places."""

from __future__ import annotations

import csv
import json
import random
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.benchmarkfolders import draw, layout_of, short_sections
from support.common.commands import fails, run
from support.common.daskcluster import DaskCluster
from support.fuzz.damage import changed

from lava_vpr.cli import main
from lava_vpr.datasets.layouts import DATASETS
from lava_vpr.experiments import cache
from lava_vpr.paper_table import run as computing
from lava_vpr.paper_table.methods import COLUMNS, METHODS, NETWORKS, PRINTED, of_network, printed
from lava_vpr.paper_table.run import counted
from lava_vpr.paper_table.sections import FIGURES, SectionTask, kept_in, measure, official, read, tasks

QUICK = ("--only", "fast", "--epochs", "4", "--jobs", "1")


@pytest.fixture(autouse=True)
def four_places() -> Iterator[None]:
    with short_sections(4):
        yield


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def everything(root: Path) -> list[str]:
    """All five datasets in their first layout of folders, ten places each, as options."""
    words = []
    for name, row in DATASETS.items():
        layout = next(layout for layout in row.layouts if not layout.folders[0].endswith(".avi"))
        tables = draw(root / name, layout, 10)
        words += ["--dataset", f"{name}={root / name}"]
        words += ["--positions", f"{name}={','.join(map(str, tables))}"] if tables else []
    return words


def nordland(root: Path, places: int = 9) -> Path:
    draw(root, layout_of("nordland", "spring"), places)
    return root


def speds(root: Path, places: int = 9) -> Path:
    draw(root, DATASETS["spedtest"].layouts[0], places)
    return root


def rows(name: str) -> dict[tuple[str, str], dict[str, Any]]:
    """The rows of a JSON file by dataset and method."""
    values = json.loads(Path(name).read_text())
    return {(part["dataset"], row["method"]): row for part in values["datasets"] for row in part["rows"]}


refused = partial(fails, "paper-table")
"""What the command says that must fail."""


def test_the_printed_numbers_are_those_of_the_paper() -> None:
    """Section VI says by how much the weighted and the probability-based assignments improve on average."""
    assert set(PRINTED) == set(DATASETS)
    assert COLUMNS == tuple(METHODS)[: len(COLUMNS)]
    values = {column: [PRINTED[name][k] for name in PRINTED] for k, column in enumerate(COLUMNS)}
    gains = [np.subtract(values[name], values["standard"]).mean() for name in ("weighted", "probability")]
    assert gains == pytest.approx([9.1, 13.8], abs=0.07)  # as it rounds
    assert printed("nordland", "weighted_probability") == 47.5
    assert printed("nordland", "loihi") is None


def test_all_five_datasets_twice_give_equal_bytes(folder: Path) -> None:
    words = everything(folder / "data")
    files = ("t.json", "t.csv", "t.md", "report/paper_table.html")

    def written(*more: str) -> list[bytes]:
        outputs = ("--json", files[0], "--csv", files[1], "--markdown", files[2], "--report", "report")
        run("paper-table", *words, "--only", "fast", "--only", "loihi", "--epochs", 4, *outputs, *more)
        return [Path(name).read_bytes() for name in files]

    first = written("--jobs", "1")
    assert first == written("--jobs", "2", "--keep", "kept") == written("--keep", "kept")
    found = rows("t.json")
    for name, dataset in DATASETS.items():
        row = found[name, "fast"]
        assert set(row["sections"]) == {str(k) for k in range(1, min(2, dataset.sections) + 1)}, name
        assert row["mean"]["recall_at_1"] >= 0.75, name
        assert row["absent"] is None
        assert found[name, "sad"]["printed"] == pytest.approx(PRINTED[name][-1] / 100)
        assert found[name, "standard"]["absent"] == "left out: --only names other networks than paper"
        assert found[name, "standard"]["mean"]["released"] is None
    page = first[2].decode()
    assert "The paper's traverses, spring and fall learned, summer recognised. 10 places; the images are enough" in page
    assert str(folder) not in b"".join(first).decode()
    with Path("t.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    means = {(line["dataset"], line["method"]): line for line in lines if line["section"] == "mean"}
    assert float(means["oxford", "hog"]["recall_at_1"]) == pytest.approx(found["oxford", "hog"]["mean"]["recall_at_1"])


def test_a_section_is_what_train_and_eval_make_of_it(folder: Path) -> None:
    """Also by preset paper, with its four decoders."""
    nordland(folder / "n")
    data = ("n", "--dataset", "nordland", "--section", 2)
    words = ("--dataset", "nordland=n", "--sections", 2, "--epochs", 2)
    run("paper-table", *words, "--only", "fast", "--only", "paper", "--json", "t.json")
    found = rows("t.json")
    for network, names in (("fast", ("contrast",)), ("paper", COLUMNS[:4])):
        run("train", *data, "--preset", network, "--epochs", 2, "-o", "m.lvpr")
        run("eval", "m.lvpr", *data, "--json", "e.json")
        values = json.loads(Path("e.json").read_text())["decoders"]
        for name in names:
            row = found["nordland", "fast" if network == "fast" else name]
            assert set(row["sections"]) == {"2"}
            own = row["sections"]["2"]
            assert {key: own[key] for key in ("recall_at_1", "recall_at_100_precision", "auc")} == {
                key: values[name][key] for key in ("recall_at_1", "recall_at_100_precision", "auc")
            }
            assert row["deviation"]["auc"] is None


def test_lists_give_the_figures_of_the_folders_that_their_images_lie_in(folder: Path) -> None:
    """Plain traverses in place of a dataset; what pages say of them is in the golden file of ``paper-fast``."""
    layout = DATASETS["spedtest"].layouts[0]
    draw(folder, layout, 9)
    run("paper-table", "--traverses", "nordland=ref,query", *QUICK, "--json", "folders.json")
    for name in layout.folders:
        Path(f"{name}.txt").write_text("".join(f"{name}/{k}.png\n" for k in range(9)))
    run("paper-table", "--traverses", "nordland=ref.txt,query.txt", *QUICK, "--json", "lists.json")
    assert Path("folders.json").read_bytes() == Path("lists.json").read_bytes()
    here = json.loads(Path("lists.json").read_text())["datasets"][0]["here"]
    assert here == {"learned": ["ref"], "recognised": "query", "official": False, "places": 9}


def test_descriptors_by_place_and_by_image(folder: Path) -> None:
    """Two reference traverses, a row for each of 9 places or of 72 images of each; the best of both counts."""
    nordland(folder / "n")
    ways = np.eye(9)
    np.save("ref.npy", np.concatenate([ways, np.roll(ways, -1, axis=0)]))
    np.save("query.npy", ways)
    whole = np.zeros((72, 9))
    whole[::8] = ways
    np.save("all_ref.npy", np.concatenate([whole, np.roll(whole, -8, axis=0)]))
    np.save("all_query.npy", whole)
    words = ("--dataset", "nordland=n", "--only", "descriptors")
    run("paper-table", *words, "--json", "absent.json")
    assert rows("absent.json")["nordland", "netvlad"]["absent"].startswith("no descriptors are given (--descriptors")
    for files in ("ref.npy,query.npy", "all_ref.npy,all_query.npy", "ref.npy,all_query.npy"):
        run("paper-table", *words, "--descriptors", f"nordland={files}", "--json", "t.json")
        row = rows("t.json")["nordland", "netvlad"]
        assert set(row["sections"]) == {"1", "2"}
        # Query k is as like place k - 1 in the second traverse as place k in the first; equal scores rank by the lower.
        assert row["mean"]["recall_at_1"] == 0.25
    np.save("ref.npy", np.concatenate([ways, ways]))
    run("paper-table", *words, "--descriptors", "nordland=ref.npy,query.npy", "--json", "t.json")
    assert rows("t.json")["nordland", "netvlad"]["mean"] == dict.fromkeys(FIGURES, 1.0)
    np.save("ref.npy", ways)
    said = refused(*words, "--descriptors", "nordland=ref.npy,query.npy")
    assert "ref.npy: has 9 rows for 18 places, or 144 images; give one row for each, the reference traverses" in said
    np.save("query.npy", np.eye(9)[:, :4])
    np.save("ref.npy", np.concatenate([ways, ways]))
    assert "elements; encode both alike" in refused(*words, "--descriptors", "nordland=ref.npy,query.npy")


def test_an_interrupted_run_goes_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    speds(folder / "s")
    words = ("--dataset", "spedtest=s", *QUICK, "--keep", "kept")
    done: list[int] = []

    def noted(shared: None, task: Any) -> Any:
        done.append(task.section)
        if task.section == 2 and done.count(2) == 1:
            raise KeyboardInterrupt
        return measure(None, task)

    monkeypatch.setattr(computing, "measure", noted)
    result = CliRunner().invoke(main, ["paper-table", *words])
    assert result.exit_code != 0
    assert "finished sections are kept in kept; the same command goes on from there" in result.stderr
    told = run("paper-table", *words, "--kept-only", "--json", "so_far.json").stdout
    assert "1; 2 not computed" in told
    row = rows("so_far.json")["spedtest", "fast"]
    assert (set(row["sections"]), row["not_computed"]) == ({"1"}, [2])
    assert done == [1, 2]
    run("paper-table", *words, "--json", "on.json")
    assert done == [1, 2, 2]
    run("paper-table", *words[:-2], "--json", "again.json")
    assert Path("on.json").read_bytes() == Path("again.json").read_bytes()


def test_what_is_kept_is_taken_for_the_same_images_settings_and_program_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    speds(folder / "s")
    source = official("spedtest", folder / "s")
    kept = kept_in(folder / "kept")
    wanted = computing.PaperRequest({"spedtest": source}, networks=("fast",), epochs=4)
    computing.paper_table(wanted, folder / "kept")
    first, second = tasks(source, "fast", (1, 2), 0, 4)
    keys = [kept.key(task) for task in (first, second)]
    assert kept.find(first, keys[0]) == measure(None, read(first))
    assert kept.find(first, keys[1]) is None
    assert kept.key(tasks(source, "fast", (1,), 0, 5)[0]) != keys[0]
    assert kept.key(tasks(source, "fast", (1,), 1, 4)[0]) != keys[0]
    with monkeypatch.context() as patched:
        patched.setattr(cache, "sources_hash", lambda function: "another program")
        assert kept.key(first) != keys[0]
    place = folder / "s" / "query" / "2.png"
    place.write_bytes((folder / "s" / "query" / "3.png").read_bytes())
    assert kept_in(folder / "kept").key(first) != keys[0]
    assert kept_in(folder / "kept").key(second) == keys[1]
    for text in ("", "[]", "{", '{"fingerprint": "x"}'):
        kept.file(first).write_text(text)
        assert kept.find(first, keys[0]) is None
    figures = measure(None, read(first))
    name, row = next(iter(figures.items()))
    made_up: list[Any] = [{}, [], {**figures, "more": row}, {**figures, name: {**row, "more": 0.5}}]
    made_up += [{**figures, name: {**row, "auc": value}} for value in (True, "0.5", 2, -0.5, None, [0.5])]
    for figures in made_up:  # with the right checksum
        kept.keep(first, keys[0], figures)
        assert kept.find(first, keys[0]) is None, figures


def test_damaged_figures_are_never_taken_for_others(tmp_path: Path) -> None:
    """Damaged as disks and copies damage files: as they were kept, or none."""
    task, kept, rng = SectionTask("spedtest", 1, "fast", 0, ()), kept_in(tmp_path), random.Random(0)
    figures = {method.name: dict.fromkeys(FIGURES, 0.25) for method in of_network("fast")}
    kept.keep(task, "key", figures)
    whole, found = kept.file(task).read_bytes(), []
    for _ in range(400):
        kind, data = changed(rng, "kept.json", whole)
        kept.file(task).write_bytes(data)
        found.append(kept.find(task, "key"))
        assert found[-1] in (None, figures), (kind, data)
    assert 0 < found.count(None) < 400


@pytest.mark.slow
def test_a_cluster_gives_the_bytes_of_this_machine(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Descriptors, too; the workers start in a folder of their own, and read nothing."""
    speds(folder / "s")
    np.save("ref.npy", np.eye(9))
    words = ("--dataset", "spedtest=s", "--epochs", 4, "--descriptors", "spedtest=ref.npy,ref.npy")
    words += ("--only", "fast", "--only", "descriptors")
    files = ("t.json", "t.csv", "t.md")

    def written(*more: object) -> list[bytes]:
        run("paper-table", *words, "--json", files[0], "--csv", files[1], "--markdown", files[2], *more)
        return [Path(name).read_bytes() for name in files]

    with DaskCluster(tmp_path_factory.mktemp("cluster")) as cluster:
        there = written("--cluster", cluster.address)
    assert there == written("--jobs", 1)
    assert set(rows("t.json")["spedtest", "netvlad"]["sections"]) == {"1", "2"}


def test_what_cannot_be_used_is_one_line(folder: Path) -> None:
    nordland(folder / "n")
    speds(folder / "s")
    (folder / "s" / "query" / "8.png").unlink()
    assert "image k must show the same place in every traverse of spedtest" in refused("--dataset", "spedtest=s")
    bad = folder / "n" / "fall" / "40.png"
    bad.write_bytes(bad.read_bytes()[:50])
    assert re.search(r"fall/40.png: .*", refused("--dataset", "nordland=n", *QUICK, "--keep", "kept"))
    assert [path.name for path in Path("kept").iterdir()] == ["nordland-fast-01-seed-0.json"]


def test_positions_say_which_images_of_traverses_at_different_speeds_are_places(folder: Path) -> None:
    tables = draw(folder / "o", layout_of("oxford", "2015-08-12-15-04-18"), 9)
    source = official("oxford", folder / "o", tables)
    assert [len(traverse) for traverse in source.traverses] == [9, 9, 9]
    assert source.traverses[0].indices.tolist() == list(range(0, 18, 2))  # an image every 5 m, a place every 10
    assert source.traverses[1].indices.tolist() == list(range(0, 36, 4))


def test_numbers_of_sections_in_words() -> None:
    assert counted([1, 2, 3, 7, 9, 10]) == "1 to 3, 7, 9 to 10"
    assert counted([]) == ""
    assert set(NETWORKS) == {method.network for method in METHODS.values()}


def test_the_page_in_docs_has_today_s_rows_and_the_printed_numbers() -> None:
    """It is written by the command that stands in it."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "paper_table.md").read_text(encoding="utf-8")
    assert "\nlava-vpr paper-table --traverses nordland=summer.txt,winter.txt " in page
    for method in METHODS.values():
        said = printed("nordland", method.name)
        assert f"| {method.title} | {'-' if said is None else said} | " in page
    for name in set(PRINTED) - {"nordland"}:
        assert f"| {DATASETS[name].title} | {' | '.join(map(str, PRINTED[name]))} | no images are given" in page
