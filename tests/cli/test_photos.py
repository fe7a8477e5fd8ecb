"""Folders as phones and cameras leave them: damaged files among many, and formats that nothing here can decode."""

from __future__ import annotations

import csv
import io
import shutil
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.common.commands import fails, figures, matches, run
from support.common.imagefiles import photo, stand_in_heif, without_heif

from lava_vpr.images.heif import decoder
from lava_vpr.model import load
from lava_vpr.traverse import Traverse

HEIC = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(40)
HEIC_PHOTO = Path(__file__).parent.parent / "images" / "heic" / "turned.heic"
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


def test_only_queries_are_looked_at_and_images_that_are_none_are_counted(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    damage("ref/img3.png")
    damage("query/img3.png")
    damage("query/img4.png")
    run("train", "ref", *TRAIN, SKIP)
    read, load_image = set[int](), Traverse.load
    monkeypatch.setattr(Traverse, "load", lambda self, k: (read.add(int(self.indices[k])), load_image(self, k))[1])
    said = run("eval", "n.lvpr", "query", SKIP).stderr
    assert read == {0, 1, 2, 4, 5}
    left = "note: query: 1 of 6 images is left out, since the map has no place of its number: 3:4\n"
    assert left in said
    Path("query/img3.png").write_bytes(Path("query/img2.png").read_bytes())
    Path("query/img4.png").write_bytes(Path("query/img2.png").read_bytes())
    assert left in run("eval", "n.lvpr", "query").stderr  # whatever was asked for
    assert "left out" not in run("eval", "n.lvpr", "query", "--gt", "gt.txt", "--places", "0:6").stderr
    assert "left out" not in run("eval", "m.lvpr", "query").stderr
    assert "note: query: 1 of 5 images cannot be read and is skipped: 4 (img4.png); the first: " in said


def test_skipped_images_are_counted_and_the_others_keep_their_numbers(place: Path) -> None:
    damage("ref/img1.png")
    damage("query/img4.png")
    said = run("train", "ref", *TRAIN, SKIP).stderr
    assert "note: ref: 1 of 6 images cannot be read and is skipped: 1 (img1.png); the first: ref/img1.png: is " in said
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
    assert "note: ref: 1 more is skipped, since an image of the same number is" in said
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


def test_images_in_the_formats_of_phones_are_named_with_the_remedy(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_heif(monkeypatch)
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
        assert "install what reads HEIC and HEIF (pip install 'lava-vpr[heic]'), or convert" in found


def asked(*words: object) -> list[dict[str, str]]:
    """The lines of a query."""
    return list(csv.DictReader(io.StringIO(run(*words, "-o", "-").stdout)))


def photos(folder: str, files: list[Path], order: list[int], tags: dict[int, Any] | None = None) -> None:
    """Photos of ``files`` in another order, 100 m and 10 s from one to the next of the old one."""
    Path(folder).mkdir()
    for number, k in enumerate(order):
        minutes, seconds = divmod(10 * k, 60)
        degrees = Fraction(round((63.4 + 0.0009 * k) * 10**6), 10**6)
        receiver = {1: "N", 2: (degrees, 0, 0), 3: "E", 4: (10, 24, 0)}
        camera = {36867: f"2024:05:01 12:{minutes:02d}:{seconds:02d}", 37521: "50", 36881: "+02:00"}
        image = cv2.imread(str(files[k]))
        assert image is not None
        photo(Path(folder) / f"IMG_{number:04d}.jpg", np.asarray(image, np.uint8), receiver, {**camera, **(tags or {})})


ORDER = [3, 0, 5, 1, 4, 2]


def test_photos_say_where_and_when_they_were_taken(place: Path) -> None:
    photos("album", sorted(Path("ref").iterdir()), ORDER)
    run("train", "album", *TRAIN, "--positions", "exif")
    model = load(Path("n.lvpr"))
    assert (model.frame, model.places) == ("latlon", 6)
    assert np.asarray(model.positions) == pytest.approx(np.array([(63.4 + 0.0009 * k, 10.4) for k in ORDER]), abs=1e-6)
    rows = asked("query", "n.lvpr", "album", "--query-positions", "exif")
    assert [float(row["time"]) for row in rows] == [1714557600.5 + 10 * k for k in ORDER]
    assert all(0 <= float(row["error_m"]) < 501 for row in rows)
    Path("n.lvpr").replace("m.lvpr")
    assert figures("album", "--query-positions", "exif", "--radius", 1)["baselines"]["sad"]["recall_at_1"] == 1.0
    said = fails("eval", "m.lvpr", "album", "--positions", "exif", "exif", "--radius", 1, code=2)
    assert "give --query-positions exif" in said


@pytest.mark.parametrize("package", ["stand-in", "pi-heif"])
def test_where_pi_heif_is_installed_heic_photos_are_photos(
    package: str, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if package == "stand-in":
        drawn = np.random.default_rng(0).integers(0, 256, (64, 48, 3)).astype(np.uint8)
        stand_in_heif(monkeypatch, lambda data: drawn)
    elif decoder() is None:
        pytest.skip("needs pi-heif: pip install 'lava-vpr[heic]'")
    photos("album", sorted(Path("ref").iterdir()), ORDER)
    shutil.copy(HEIC_PHOTO, "album/IMG_0002a.HEIC")
    Path("album/IMG_0004a.heic").write_bytes(HEIC_PHOTO.read_bytes()[:-9])
    said = fails("train", "album", *TRAIN, "--positions", "exif")
    assert said.startswith("album/IMG_0004a.heic: cannot be read (it has 1,331 of 1,340 bytes); copy it again")
    said = run("train", "album", *TRAIN, "--positions", "exif", SKIP).stderr
    assert "note: album: 1 of 8 images cannot be read" in said
    assert "skipped: 6 (IMG_0004a.heic); the first: album/IMG_0004a.heic: is damaged or cut short (it has" in said
    positions = np.asarray(load(Path("n.lvpr")).positions)
    assert positions.shape == (7, 2)
    assert positions[3] == pytest.approx((63.4, 10.4), abs=1e-6)
    rows = asked("query", "n.lvpr", "album", "--query-positions", "exif", SKIP)
    assert (rows[3]["query_name"], float(rows[3]["time"])) == ("IMG_0002a.HEIC", 1714557610.5)
    (row,) = asked("query", "n.lvpr", "album/IMG_0002a.HEIC")
    assert row["place"] == "3"


def without_exif(number: int) -> None:
    """Write a photo of the album again, as OpenCV does, without EXIF."""
    path = Path(f"album/IMG_{number:04d}.jpg")
    image = cv2.imread(str(path))
    assert image is not None
    cv2.imwrite(str(path), image)


def test_photos_without_a_position_are_counted_and_none_is_taken_silently(place: Path) -> None:
    photos("album", sorted(Path("ref").iterdir()), ORDER)
    without_exif(2)
    lost = "album: 1 of 6 photos does not say in its EXIF where it was taken (the first is IMG_0002.jpg, image 2)"
    assert fails("train", "album", *TRAIN, "--positions", "exif").startswith(lost)
    lost = "1 of 6 images cannot be read, or does not say where it was taken, and is skipped: 2 (IMG_0002.jpg)"
    assert lost in run("train", "album", *TRAIN, "--positions", "exif", SKIP).stderr
    without_exif(4)
    said = fails("train", "album", *TRAIN, "--positions", "exif")
    lost = "album: 2 of 6 photos do not say in their EXIF where they were taken (the first is IMG_0002.jpg, image 2)"
    assert said.startswith(lost)
    assert said.endswith("give positions as a CSV or GPX file, or leave such images out with --skip-unreadable")
    said = run("train", "album", *TRAIN, "--positions", "exif", SKIP).stderr
    lost = "2 of 6 images cannot be read, or do not say where they were taken, and are skipped: 2 (IMG_0002.jpg), "
    assert lost in said
    assert load(Path("n.lvpr")).place_indices.tolist() == [0, 1, 3, 5]
    run("extend", "n.lvpr", "album", "--positions", "exif", SKIP, "--allow-duplicates")
    assert load(Path("n.lvpr")).places == 8
    np.save("v.npy", np.random.default_rng(0).normal(size=(6, 20)))
    said = fails("train", "v.npy", "-o", "v.lvpr", "--positions", "exif")
    assert said == "v.npy: only image files have EXIF; give positions as a CSV or GPX file"


def test_where_no_photo_has_a_position_none_is_to_be_left_out(place: Path) -> None:
    photos("album", sorted(Path("ref").iterdir()), ORDER)
    run("train", "album", *TRAIN, "--positions", "exif")
    query, by = ("query", "n.lvpr"), ("--query-positions", "exif")
    remedy = "give positions as a CSV or GPX file, or train without --positions (queries: without --query-positions)"
    for words in (("train", "ref", *TRAIN, "--positions", "exif"), (*query, "ref", *by, "-o", "q.csv")):
        for skip in ((), (SKIP,)):
            said = fails(*words, *skip)
            assert said == f"ref: none of its 6 photos says in its EXIF where it was taken; {remedy}"
    said = fails(*query, "ref/img0.png", *by)
    assert said.startswith("ref/img0.png: the photo does not say in its EXIF where it was taken; give ")
    damage("ref/img2.png")
    said = fails("train", "ref", *TRAIN, "--positions", "exif", SKIP)
    assert said == "ref: none of its 6 images is left; copy them again"


@pytest.mark.parametrize(
    ("tags", "said"),
    [
        ({36867: "unknown"}, "5 of 6 photos say when they were taken; no times are taken from them"),
        ({36881: ""}, "5 of 6 photos say how far their clock is from UTC; no times are taken from them"),
    ],
)
def test_times_that_cannot_be_compared_are_told_and_left(place: Path, tags: dict[int, str], said: str) -> None:
    files = sorted(Path("ref").iterdir())
    photos("album", files, ORDER)
    photos("other", files, [0], tags)
    Path("other/IMG_0000.jpg").replace("album/IMG_0001.jpg")
    told = run("train", "album", *TRAIN, "--positions", "exif").stderr
    assert f"note: album: {said}" in told
    assert "time" not in asked("query", "n.lvpr", "album", "--query-positions", "exif")[0]


def test_positions_of_photos_that_nothing_uses_are_told_of(place: Path) -> None:
    """Whoever takes the order of file names for that of places is told of the way that needs no order."""
    photos("album", sorted(Path("ref").iterdir()), ORDER)
    assert (
        "album say where they were taken, which is not used; with --positions" in run("train", "album", *TRAIN).stderr
    )
    by_order = "album say where they were taken; if they are in another order, train with --positions exif and give"
    assert by_order in run("eval", "n.lvpr", "album").stderr
    assert "say where" not in run("train", "album", *TRAIN, "--positions", "exif").stderr
    assert "another order, give --query-positions exif" in run("eval", "n.lvpr", "album").stderr
    assert "say where" not in run("eval", "n.lvpr", "album", "--query-positions", "exif").stderr
    assert "say where" not in run("eval", "m.lvpr", "query").stderr


def test_no_match_that_can_be_accepted_is_explained(place: Path) -> None:
    said = run("query", "m.lvpr", "query", "-o", "q.csv", "--target-precision", 0.9999)
    assert said.stdout == "6 images, 0 accepted: q.csv\n"
    assert "No probability is high enough" in said.stderr
    assert "--off-map 0" in said.stderr


@pytest.mark.slow
def test_a_folder_of_a_phone_becomes_a_report_in_two_commands(
    data_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """60 real photos out of order, two of them damaged and one HEIC; queries of another season, likewise."""
    monkeypatch.chdir(tmp_path)
    without_heif(monkeypatch)
    for seed, season in enumerate(("summer", "winter")):
        files = sorted((data_root / "data" / "nordland" / season).iterdir())[:60]
        photos(season, files, np.random.default_rng(seed).permutation(60).tolist())
        for number in (7 + seed, 31):
            path = Path(season) / f"IMG_{number:04d}.jpg"
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        Path(season, "IMG_0060.HEIC").write_bytes(HEIC)
    said = run("train", "summer", "-o", "m.lvpr", "--positions", "exif", SKIP).stderr
    assert "2 of 60 images cannot be read" in said
    assert "holds 1 image in a format that cannot be read (first: IMG_0060.HEIC)" in said
    said = run("query", "m.lvpr", "winter", "--query-positions", "exif", SKIP, "--report", "r").stdout
    assert "58 images" in said
    page = Path("r/query.html").read_text(encoding="utf-8")
    assert "IMG_0059.jpg" in page
    assert "IMG_0031.jpg" not in page
    found = figures("winter", "--query-positions", "exif", "--radius", 25, SKIP)
    assert found["queries"] == 58
    assert found["decoders"]["contrast"]["recall_at_1"] > 0.8


def test_arguments_that_are_swapped_are_named(place: Path) -> None:
    said = "m.lvpr is a model, and query is not; give the model first, then the images"
    for command in ("query", "eval", "watch", "verify", "bench"):
        assert fails(command, "query", "m.lvpr") == said
    assert "m.lvpr: is of no known type" in fails("query", "m.lvpr", "m.lvpr")


def test_images_that_are_all_alike_are_said_to_be(place: Path) -> None:
    Path("same").mkdir()
    for k in range(5):
        shutil.copy("ref/img0.png", f"same/{k}.png")
    assert "all reference images are alike" in fails("train", "same", "-o", "n.lvpr")
