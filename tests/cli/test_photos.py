"""Folders as phones and cameras leave them: damaged files among many, and formats that nothing here can decode."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from support.common.commands import fails, figures, matches, run

from lava_vpr.model import load

HEIC = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(40)
SKIP = "--skip-unreadable"
TRAIN = ("-o", "n.lvpr", "--config", "quick.toml")


@pytest.fixture(autouse=True)
def _same(place: Path) -> None:
    """The queries are the references."""
    for path in Path("ref").iterdir():
        shutil.copy(path, Path("query") / path.name)


def damage(path: str) -> None:
    """Cut an image file short."""
    Path(path).write_bytes(Path(path).read_bytes()[:60])


def test_without_the_option_the_first_unreadable_image_names_it(place: Path) -> None:
    damage("ref/img3.png")
    damage("query/img3.png")
    remedy = "copy it again or remove it, or leave such images out with --skip-unreadable"
    for words in (("train", "ref", *TRAIN), ("extend", "m.lvpr", "ref"), ("query", "m.lvpr", "query", "-o", "q.csv")):
        said = fails(*words)
        assert "/img3.png: is damaged or cut short" in said
        assert said.endswith(remedy)
    assert fails("eval", "m.lvpr", "query").endswith(remedy)
    assert SKIP not in fails("verify", "m.lvpr", "query")  # it has no such option


def test_skipped_images_are_counted_and_the_others_keep_their_numbers(place: Path) -> None:
    damage("ref/img1.png")
    damage("query/img4.png")
    said = run("train", "ref", *TRAIN, SKIP).stderr
    assert "note: ref: 1 of 6 images cannot be read and are skipped: 1 (img1.png); the first: ref/img1.png: is " in said
    model = load(Path("n.lvpr"))
    assert model.place_indices.tolist() == [0, 2, 3, 4, 5]
    assert model.route_images == 6
    answers = matches("query", SKIP)
    assert [row["query"] for row in answers] == ["0", "1", "2", "3", "5"]
    assert [row["query_name"] for row in answers] == [f"img{k}.png" for k in (0, 1, 2, 3, 5)]
    assert matches("query", SKIP, "--places", "3:6") == [row for row in answers if int(row["query"]) >= 3]
    Path("n.lvpr").replace("m.lvpr")
    by_order, by_file = figures("query", SKIP), figures("query", SKIP, "--gt", "gt.txt")
    assert by_order["queries"] == 4  # images 0, 2, 3 and 5
    assert by_file["queries"] == 5  # image 1 too, whose place was not learned
    assert by_order["baselines"]["sad"]["recall_at_1"] == 1.0
    assert by_file["baselines"]["sad"]["recall_at_1"] == pytest.approx(4 / 5)


def test_by_order_a_skipped_query_leaves_its_place_without_one(place: Path) -> None:
    """Queries that are another part of the route show its places one by one, also where one cannot be read."""
    for k in reversed(range(6)):
        Path(f"query/img{k}.png").rename(f"query/img{k + 1}.png")
    Path("query/img0.png").write_bytes(Path("query/img1.png").read_bytes())  # seven: one is before the route
    damage("query/img3.png")
    found = figures("query", SKIP, "--places", "1:7")
    assert found["queries"] == 5
    assert found["baselines"]["sad"]["recall_at_1"] == 1.0


def test_traverses_in_step_lose_the_same_places(place: Path) -> None:
    damage("ref/img1.png")
    damage("query/img4.png")
    said = run("train", "ref", "query", *TRAIN, SKIP).stderr
    assert "note: ref: 1 more are skipped, which show the places of such images" in said
    assert load(Path("n.lvpr")).place_indices.tolist() == [0, 2, 3, 5]
    run("extend", "n.lvpr", "query", "ref", SKIP, "--allow-duplicates")
    assert len(load(Path("n.lvpr")).place_indices) == 8


def test_positions_by_row_stay_those_of_the_files(place: Path) -> None:
    damage("ref/img1.png")
    run("train", "ref", *TRAIN, SKIP, "--positions", "xy.csv")
    positions = load(Path("n.lvpr")).positions
    assert positions is not None
    assert np.asarray(positions)[:, 0].tolist() == [0, 2, 3, 4, 5]
    damage("query/img2.png")
    Path("n.lvpr").replace("m.lvpr")
    found = figures("query", SKIP, "--query-positions", "xy.csv", "--radius", 0.5)
    assert found["queries"] == 5
    assert found["baselines"]["sad"]["recall_at_1"] == pytest.approx(4 / 5)  # of image 1 no place was learned


def test_many_are_named_in_one_line_and_none_left_is_an_error(place: Path) -> None:
    for k in range(5):
        damage(f"query/img{k}.png")
    said = run("query", "m.lvpr", "query", SKIP, "-o", "q.csv").stderr
    assert "5 of 6 images cannot be read and are skipped: 0 (img0.png), 1 (img1.png), 2 (img2.png) and 2 more;" in said
    damage("query/img5.png")
    assert fails("query", "m.lvpr", "query", SKIP, "-o", "q.csv").startswith("query: none of its 6 images is left")
    assert "leave out --skip-unreadable" in fails("train", "ref", *TRAIN, SKIP, "--dataset", "nordland", code=2)


def test_images_in_the_formats_of_phones_are_named_with_the_remedy(place: Path) -> None:
    for name in ("ref/b.HEIC", "ref/a.avif", "alone/IMG_1.heic", "named/1.jpg"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_bytes(HEIC)
    said = run("train", "ref", *TRAIN).stderr
    assert said.count("note: ref: holds 2 images in a format that cannot be read (first: a.avif), left out here; ") == 1
    for words, cause in (
        (("train", "alone", *TRAIN), "alone: holds only 1 image in a format that cannot be read (first: IMG_1.heic)"),
        (("query", "m.lvpr", "alone/IMG_1.heic"), "alone/IMG_1.heic: is in a format that cannot be read"),
        (("query", "m.lvpr", "named", "-o", "q.csv"), "1.jpg: is a HEIC, HEIF or AVIF image, which cannot be read"),
    ):
        found = fails(*words)
        assert cause in found
        assert "convert such images to JPEG (magick mogrify -format jpg *.heic" in found
