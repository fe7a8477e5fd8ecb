"""``lava-vpr datasets``, and ``train`` and ``eval --dataset``, on drawn images in the official folders."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.benchmarkfolders import draw, layout_of, short_sections
from support.common.commands import fails, run

from lava_vpr import model as model_file
from lava_vpr.cli import main
from lava_vpr.datasets.layouts import DATASETS

QUICK = ("--preset", "fast", "--epochs", "4")


@pytest.fixture(autouse=True)
def four_places() -> Iterator[None]:
    with short_sections(4):
        yield


def evaluated(*words: object) -> dict[str, object]:
    run("eval", *words, "--json", "f.json")
    return dict(json.loads(Path("f.json").read_text()))


def recall(values: dict[str, object]) -> float:
    return float(values["decoders"]["contrast"]["recall_at_1"])  # type: ignore[index]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_list_and_each_dataset(folder: Path) -> None:
    listed = run("datasets", "--json", "all.json").stdout
    values = json.loads(Path("all.json").read_text())["datasets"]
    assert [row["name"] for row in values] == list(DATASETS)
    for name, row in DATASETS.items():
        assert row.title in listed
        assert row.page in listed
        told = run("datasets", name).stdout
        for text in (row.page, row.download, row.unsaid, row.truth, *(part for x in row.layouts for part in x.folders)):
            assert text in told
    assert "'kitti' is not one of 'nordland', 'oxford'" in fails("datasets", "kitti", code=2)


def test_a_check_on_the_terminal(folder: Path) -> None:
    draw(folder, layout_of("nordland", "spring"), 9)
    told = run("datasets", "nordland", ".", "--json", "n.json").stdout
    assert "9 places: 2 of the paper's 15 sections" in told
    assert told.endswith("usable\n")
    assert json.loads(Path("n.json").read_text())["sections"] == 2
    (folder / "fall" / "3.png").unlink()
    result = CliRunner().invoke(main, ["datasets", "nordland", "."])
    assert result.exit_code == 1
    assert "differs: image k must show the same place in every traverse of nordland, but" in result.stdout
    assert result.stdout.endswith("not usable\n")
    assert "it needs the folders ref (missing) + query (missing)" in fails("datasets", "spedtest", ".")


def test_a_section_is_the_paper_s_sampled_places(folder: Path) -> None:
    """The same as training the sampled images of both traverses from lists, but for their absolute indices."""
    draw(folder, layout_of("nordland", "spring"), 9)
    run("train", ".", "--dataset", "nordland", "--section", 2, "-o", "two.lvpr", *QUICK)
    two = model_file.load("two.lvpr")
    assert two.place_indices.tolist() == [32, 40, 48, 56]
    assert two.route_images == 72
    for season in ("spring", "fall"):
        Path(f"{season}.txt").write_text("".join(f"{season}/{k}.png\n" for k in (32, 40, 48, 56)))
    run("train", "spring.txt", "fall.txt", "-o", "lists.lvpr", *QUICK)
    listed = model_file.load("lists.lvpr")
    np.testing.assert_array_equal(two.network.weights, listed.network.weights)  # type: ignore[union-attr]
    np.testing.assert_array_equal(two.responses, listed.responses)
    found = evaluated("two.lvpr", ".", "--dataset", "nordland", "--section", 2)
    assert found == evaluated("two.lvpr", ".", "--dataset", "nordland") == evaluated("two.lvpr", "summer")
    assert found["queries"] == 4
    assert recall(found) >= 0.75
    assert "section 1 of Nordland is images 0:32, of which the model has learned none" in fails(
        "eval", "two.lvpr", ".", "--dataset", "nordland", "--section", 1
    )
    assert "spring: gives 9 places, section 3 of Nordland is places 8:12" in fails(
        "train", ".", "--dataset", "nordland", "--section", 3, "-o", "m.lvpr"
    )
    assert "section 16 of Nordland is none of the paper's; it has sections 1 to 15" in fails(
        "train", ".", "--dataset", "nordland", "--section", 16, "-o", "m.lvpr"
    )


def test_all_places_and_one_section_of_the_queries(folder: Path) -> None:
    draw(folder, DATASETS["spedtest"].layouts[0], 9)
    run("train", ".", "--dataset", "spedtest", "-o", "all.lvpr", *QUICK)
    assert model_file.load("all.lvpr").places == 9
    whole = evaluated("all.lvpr", ".", "--dataset", "spedtest")
    assert (whole["queries"], whole["followed"]) == (9, {})  # cameras all over the world are no drive
    assert evaluated("all.lvpr", ".", "--dataset", "spedtest", "--motion", "any")["followed"]
    part = evaluated("all.lvpr", ".", "--dataset", "spedtest", "--section", 2)
    assert (part["queries"], part["places"]) == (4, 9)


def test_traverses_at_different_speeds_take_positions(folder: Path) -> None:
    sun, rain, dusk = draw(folder, layout_of("oxford", "2015-08-12-15-04-18"), 9)
    learn = ("train", ".", "--dataset", "oxford", "--section", 2, "-o", "o.lvpr", *QUICK)
    said = fails(*learn)
    assert "2015-08-12-15-04-18, 2015-10-29-12-18-17: only positions tell which images are the places of" in said
    assert said.endswith("give --positions FILE once for each of the traverses, in this order")
    run(*learn, "--positions", sun, "--positions", rain)
    model = model_file.load("o.lvpr")
    assert model.place_indices.tolist() == [8, 10, 12, 14]  # an image every 5 m, a place every 10
    ask = ("eval", "o.lvpr", ".", "--dataset", "oxford")
    assert "nothing tells which place a query shows, since the traverses of this dataset are not in step" in fails(*ask)
    found = evaluated(*ask[1:], "--query-positions", dusk)
    assert found["queries"] == 4
    assert found["position_error"]["radius_m"] == 5.0  # type: ignore[index]
    assert recall(found) >= 0.75
    assert "leave out --section" in fails(*ask, "--section", 2, "--query-positions", dusk, code=2)
    assert "--tolerance counts along the route" in fails(*ask, "--tolerance", 1, code=2)
    wide = evaluated(*ask[1:], "--query-positions", dusk, "--radius", 12)
    assert wide["position_error"]["radius_m"] == 12.0  # type: ignore[index]


@pytest.mark.parametrize("name", ["synthia", "st_lucia"])
def test_the_other_datasets_with_positions(folder: Path, name: str) -> None:
    layout = next(layout for layout in DATASETS[name].layouts if not layout.folders[0].endswith(".avi"))
    reference, query = draw(folder, layout, 6)
    learn = ("train", ".", "--dataset", name, "--section", 1, "-o", "m.lvpr", *QUICK)
    if layout.needs_positions:
        assert "only positions tell which images are the places of St Lucia; give --positions FILE" in fails(*learn)
    run(*learn, "--positions", reference)
    assert model_file.load("m.lvpr").places == 4
    assert "nothing tells which place a query shows" in fails("eval", "m.lvpr", ".", "--dataset", name)
    found = evaluated("m.lvpr", ".", "--dataset", name, "--query-positions", query)
    assert found["queries"] == 4
    assert recall(found) >= 0.75


def test_what_does_not_go_with_a_dataset(folder: Path) -> None:
    draw(folder, DATASETS["spedtest"].layouts[0], 5)
    train = ("train", ".", "-o", "m.lvpr", *QUICK)
    assert "--section is one of a dataset's; give --dataset NAME" in fails(*train, "--section", 1, code=2)
    data = (*train, "--dataset", "spedtest")
    assert "leave out --places" in fails(*data, "--places", "0:4", code=2)
    assert "--dataset takes one folder, which holds the dataset; 2 are given" in fails(*data, "ref", code=2)
    assert ", or spring (missing) + fall (missing) + summer (missing)" in fails(*train, "--dataset", "nordland")
    bad = folder / "ref" / "2.png"
    whole = bad.read_bytes()
    bad.write_bytes(b"no image")
    assert str(Path("ref") / "2.png") in fails(*data)
    bad.write_bytes(whole)
    run(*data)
    (folder / "query" / "4.png").unlink()
    assert "query: has 4 queries, the references 5" in fails("eval", "m.lvpr", ".", "--dataset", "spedtest")
