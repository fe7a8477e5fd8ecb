"""The benchmark layouts: found, sampled, and missing parts named."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray
from support.common.benchmarkfolders import folder_of, layout_of
from support.common.imagefiles import QUICK, refused, written

from lava_vpr.datasets.layouts import DATASETS, DatasetLayout, check_lengths, find_layout
from lava_vpr.datasets.selecting import check
from lava_vpr.errors import InputError
from lava_vpr.traverse import Traverse, open_traverse
from lava_vpr.truth.alignment import read_ground_truth


def fill(folder: Path, images: int = 3, level: int = 0) -> None:
    """``images`` small images; the grey level tells the folder, unpadded numbers need the natural sort."""
    folder.mkdir(parents=True)
    for k in range(images):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((4, 4), (20 * level + k) % 256, dtype=np.uint8))


def build(root: Path, layout: DatasetLayout, images: int = 3) -> None:
    root.mkdir(exist_ok=True)
    for level, relative in enumerate((*layout.references, layout.query)):
        if relative.endswith(".avi"):
            path = root / relative
            path.parent.mkdir(parents=True)
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 1.0, (32, 32))
            for _ in range(images):
                writer.write(np.zeros((32, 32, 3), dtype=np.uint8))
            writer.release()
        else:
            fill(folder_of(root, relative, images), images, level)


def opened(name: str, root: Path) -> tuple[list[Traverse], Traverse]:
    """The sampled references and the sampled query of a dataset."""
    found = find_layout(name, root)
    whole = [open_traverse(path, every=found.layout.every) for path in (*found.references, found.query)]
    check_lengths(found, whole)
    *references, query = map(found.sampled, whole)
    return references, query


EVERY_LAYOUT = [
    pytest.param(name, layout, id=f"{name}-{k}")
    for name, dataset in DATASETS.items()
    for k, layout in enumerate(dataset.layouts)
]


@pytest.mark.parametrize(("name", "layout"), EVERY_LAYOUT)
def test_every_layout_is_found(tmp_path: Path, name: str, layout: DatasetLayout) -> None:
    build(tmp_path, layout, 11)
    found = find_layout(name, tmp_path)
    assert found.layout == layout
    assert found.references == tuple(tmp_path / relative for relative in layout.references)
    assert found.query == tmp_path / layout.query
    traverses, queries = opened(name, tmp_path)
    assert len(traverses) == len(layout.references)
    for traverse in (*traverses, queries):
        assert traverse.indices.tolist() == list(range(0, 11, layout.step))


def test_the_paper_s_traverses() -> None:
    nordland = layout_of("nordland", "spring")
    assert (nordland.references, nordland.query, nordland.step) == (("spring", "fall"), "summer", 8)
    lists = DATASETS["nordland"].layouts[0]
    assert lists.folders == tuple(f"nordland_imageNames_{season}.txt" for season in ("spring", "fall", "summer"))
    assert lists.step == 8
    drives = DATASETS["oxford"].layouts[0]
    assert drives.folders == tuple(f"ORC_imageNames_{drive}.txt" for drive in ("Sun", "Rain", "Dusk"))
    assert (drives.step, drives.ground_truth) == (8, "frames")
    oxford = DATASETS["oxford"].layouts[1]
    assert oxford.references == ("2015-08-12-15-04-18/stereo/left", "2015-10-29-12-18-17/stereo/left")
    assert oxford.query == "2014-11-21-16-07-03/stereo/left"
    synthia = DATASETS["synthia"].layouts[0]
    assert synthia.references == ("SYNTHIA-SEQS-04-FOG/RGB/Stereo_Left/Omni_F",)
    assert synthia.query == "SYNTHIA-SEQS-04-NIGHT/RGB/Stereo_Left/Omni_F"
    lucia = DATASETS["st_lucia"].layouts[0]
    assert (lucia.references, lucia.query) == (("190809_0845/webcam_video.avi",), "180809_1545/webcam_video.avi")


def test_sampling_keeps_absolute_indices_and_the_order_of_traverses(tmp_path: Path) -> None:
    build(tmp_path, layout_of("nordland", "spring"), 18)
    (spring, fall), summer = opened("nordland", tmp_path)
    assert summer.names == ("0.png", "8.png", "16.png")
    assert [int(image[0, 0]) for image in spring.images()] == [0, 8, 16]
    assert [int(image[0, 0]) for image in fall.images()] == [20, 28, 36]
    assert [int(image[0, 0]) for image in summer.images()] == [40, 48, 56]


def test_letter_case_of_folders_does_not_matter(tmp_path: Path) -> None:
    for level, name in enumerate(("Sun", "RAIN", "Dusk")):
        fill(tmp_path / name, 2, level)
    (sun, rain), dusk = opened("oxford", tmp_path)
    assert [int(t.load(0)[0, 0]) for t in (sun, rain, dusk)] == [0, 20, 40]
    assert rain.source == str(tmp_path / "RAIN")


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    fill(tmp_path / "spring")
    with pytest.raises(InputError) as caught:
        opened("nordland", tmp_path)
    assert str(caught.value) == (
        f"{tmp_path}: does not hold the nordland dataset; "
        "it needs the folders nordland_imageNames_spring.txt (missing) + nordland_imageNames_fall.txt (missing) + "
        "nordland_imageNames_summer.txt (missing), or spring + fall (missing) + summer (missing)"
    )
    refused(lambda: opened("synthia", tmp_path), "Omni_F (missing), or SEQS-04-FOG", ", or ref (missing) + query (miss")
    refused(
        lambda: opened("spedtest", tmp_path / "no"),
        "no: is not a folder; give the folder that holds the spedtest dataset",
    )
    refused(
        lambda: find_layout("kitti", tmp_path),
        "no dataset 'kitti'; choose from nordland, oxford, spedtest, synthia, st_l",
    )


def test_unequal_lengths_are_refused_only_where_images_correspond(tmp_path: Path) -> None:
    fill(tmp_path / "sped" / "ref", 3)
    fill(tmp_path / "sped" / "query", 4)
    refused(
        lambda: opened("spedtest", tmp_path / "sped"),
        "image k must show the same place",
        "ref has 3, ",
        "query has 4; complete them",
    )
    fog, night = (tmp_path / f"SYNTHIA-SEQS-04-{n}" / "RGB" / "Stereo_Left" / "Omni_F" for n in ("FOG", "NIGHT"))
    fill(fog, 6)
    fill(night, 12)
    (reference,), query = opened("synthia", tmp_path)
    assert (reference.indices.tolist(), query.indices.tolist()) == ([0, 5], [0, 5, 10])


def test_sections_are_counted_from_one_and_in_sampled_places(tmp_path: Path) -> None:
    build(tmp_path, layout_of("nordland", "spring"), 1700)
    found = find_layout("nordland", tmp_path)
    (spring, _), _ = opened("nordland", tmp_path)
    assert DATASETS["nordland"].section(15) == (1400, 1500)
    assert found.of_section(spring, 2).indices.tolist() == list(range(800, 1600, 8))
    refused(
        lambda: found.of_section(spring, 3), "spring: gives 213 places, section 3 of Nordland is places 200:300; compl"
    )
    for number in (0, 16):
        with pytest.raises(InputError, match=rf"section {number} of Nordland is none of the paper's; it has sections"):
            found.of_section(spring, number)
    seen = check("nordland", tmp_path)
    assert (seen.places, seen.sections, seen.usable) == (213, 2, True)
    assert [one.images for one in seen.traverses] == [1700] * 3
    assert seen.differs == (
        "213 places are enough for 2 of the paper's 15 sections of 100; all take 11,993 images of each traverse",
    )


def test_folders_of_more_images_than_the_paper_keeps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every eighth of them is another place than in the authors' lists."""
    lists, folders = DATASETS["nordland"].layouts
    assert (lists.kept, folders.kept) == (None, 27_592)
    row = dataclasses.replace(DATASETS["nordland"], places=1, layouts=(lists, dataclasses.replace(folders, kept=10)))
    monkeypatch.setitem(DATASETS._rows, "nordland", row)
    build(tmp_path / "whole", folders, 18)
    said = check("nordland", tmp_path / "whole").differs[0]
    assert said.startswith("folders of 18 images, of which the paper keeps 10: every 8th is another place than the pap")
    build(tmp_path / "kept", folders, 10)
    assert "keeps" not in " ".join(check("nordland", tmp_path / "kept").differs)
    build(tmp_path / "listed", lists, 18)
    assert "keeps" not in " ".join(check("nordland", tmp_path / "listed").differs)


def test_what_a_check_finds(tmp_path: Path) -> None:
    fill(tmp_path / "ref", 100)
    fill(tmp_path / "query", 100)
    last = tmp_path / "query" / "99.png"
    last.write_bytes(last.read_bytes()[:40])
    seen = check("spedtest", tmp_path)
    assert not seen.usable
    assert len(seen.differs) == 2
    assert str(last) in seen.differs[0]
    cv2.imwrite(str(last), np.zeros((4, 4), np.uint8))
    cv2.imwrite(str(tmp_path / "query" / "0.png"), np.zeros((6, 5), np.uint8))
    seen = check("spedtest", tmp_path)
    assert seen.usable
    assert (seen.places, seen.sections) == (100, 1)
    assert seen.differs[0] == ("images are of different sizes (pixels): ref 4 x 4, query 5 x 6; all are resized alike")
    last.unlink()
    seen = check("spedtest", tmp_path)
    assert not seen.usable
    assert "image k must show the same place in every traverse of spedtest, but" in seen.differs[0]


@pytest.mark.parametrize(("name", "layout"), EVERY_LAYOUT)
def test_a_check_of_every_layout(tmp_path: Path, name: str, layout: DatasetLayout) -> None:
    """Eleven images are too few for a section, unless positions say how many places they are."""
    build(tmp_path, layout, 11)
    seen = check(name, tmp_path)
    assert [one.folder for one in seen.traverses] == list(layout.folders)
    assert {one.images for one in seen.traverses} == {11}
    assert (seen.sections is None) == layout.needs_positions == seen.usable
    values = seen.as_json()
    assert values["sections_of_the_paper"] == DATASETS[name].sections
    assert str(tmp_path) not in str(values)


def test_every_row_names_a_page_and_the_paper_s_sections() -> None:
    sections = {name: (row.sections, row.places) for name, row in DATASETS.items()}
    assert sections == {
        "nordland": (15, 100),
        "oxford": (4, 100),
        "spedtest": (6, 100),
        "synthia": (1, 100),
        "st_lucia": (1, 100),
    }
    assert all(row.page.startswith("https://") for row in DATASETS.values())
    assert DATASETS["nordland"].task == "spring and fall learned, summer recognised"
    assert {layout.spacing for layout in DATASETS["oxford"].layouts} == {10.0, None}
    assert {layout.spacing for layout in DATASETS["st_lucia"].layouts} == {20.0, None}


def test_an_empty_folder_is_named(tmp_path: Path) -> None:
    fill(tmp_path / "ref")
    (tmp_path / "query").mkdir()
    refused(lambda: opened("spedtest", tmp_path), "query: holds no images")


# ---------------------------------------------------------------- ground truth

QUERIES, PLACES = np.array([10, 11, 12], dtype=np.int64), np.array([20, 21, 22, 23], dtype=np.int64)
#: Query 10 is at 20 and 21, query 11 nowhere, query 12 at 23.
TRUTH = np.array([[1, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]], dtype=bool)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("t.txt", "# truth\n10: 20 21\n11:\n12: 23 99\n"),
        ("t.txt", "12 23\n10 21 # not 22\n10 20\n5 1\n"),
        ("t.csv", "query,places\n10,20;21\n12,23\n"),
        ("t.csv", "10,20,21\r\n11\r\n12,23\r\n"),
        ("t.json", '{"10": [20, 21], "11": [], "12": 23, "77": [1]}'),
        ("t.json", '{"10": [20], "10": 21, "12": [23]}'),
        ("t.json", "[[20, 21], [], [23, 5]]"),
        ("t.json", json.dumps([[]] * 10 + [[20, 21], [], 23])),
    ],
)
def test_ground_truth_as_text(tmp_path: Path, name: str, text: str) -> None:
    got = read_ground_truth(written(tmp_path / name, text.encode()), QUERIES, PLACES)
    assert got.dtype == np.bool_
    np.testing.assert_array_equal(got, TRUTH)


def _wide() -> NDArray[np.bool_]:
    wide = np.zeros((13, 24), dtype=bool)
    wide[10:13, 20:24] = TRUTH
    wide[3, 3] = True
    return wide


@pytest.mark.parametrize(
    "array",
    [
        np.array([[10, 20], [12, 23], [10, 21], [3, 4]]),
        np.array([[12, 23], [10, 20], [10, 21]], dtype=np.uint16),
        TRUTH,
        TRUTH.astype(np.uint8),
        TRUTH.astype(np.float64),
        _wide(),
        _wide()[:, :24].astype(np.int64),
    ],
)
def test_ground_truth_as_array(tmp_path: Path, array: NDArray[np.generic]) -> None:
    np.save(tmp_path / "t.npy", array)
    np.testing.assert_array_equal(read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), TRUTH)


def test_a_matrix_with_a_row_for_each_place(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    np.save(tmp_path / "t.npy", TRUTH.T)
    np.testing.assert_array_equal(read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), TRUTH)
    assert "t.npy: has a row for each place and a column for each query, and is read so" in caplog.text


def test_ground_truth_with_places_beside(tmp_path: Path) -> None:
    """What is beside counts by index: 19 is no place of the run, 20 is beside it; between 20 and 24, two are."""
    path = written(tmp_path / "t.txt", b"10: 19\n11:\n12: 24 20\n")
    for tolerance, wanted in ((1, [[1, 0, 0, 0], [0] * 4, [1, 1, 0, 1]]), (2, [[1, 1, 0, 0], [0] * 4, [1] * 4])):
        np.testing.assert_array_equal(read_ground_truth(path, QUERIES, PLACES, tolerance), wanted)


def test_ground_truth_as_one_place_a_query(tmp_path: Path) -> None:
    expected = np.array([[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]], dtype=bool)
    for array in ([21, -1, 23], [0] * 10 + [21, -1, 23, 7]):
        np.save(tmp_path / "t.npy", np.array(array))
        np.testing.assert_array_equal(read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), expected)


@QUICK
@given(st.lists(st.lists(st.integers(0, 30), max_size=4), min_size=1, max_size=8), st.integers(0, 20))
def test_all_formats_say_the_same(tmp_path_factory: pytest.TempPathFactory, sets: list[list[int]], offset: int) -> None:
    base = tmp_path_factory.mktemp("t")
    queries = np.arange(offset, offset + len(sets), dtype=np.int64)
    places = np.arange(31, dtype=np.int64)
    literal = np.array([[int(p) in places_of for p in places] for places_of in sets])
    text = "".join(f"{q}: {' '.join(map(str, s))}\n" for q, s in zip(queries, sets, strict=True))
    mapping = {str(q): s for q, s in zip(queries, sets, strict=True)}
    written(base / "a.txt", text.encode())
    written(base / "a.csv", text.replace(": ", ",").replace(" ", ";").encode())
    written(base / "a.json", json.dumps(mapping).encode())
    written(base / "b.json", json.dumps(sets).encode())
    np.save(base / "a.npy", literal)
    for name in ("a.txt", "a.csv", "a.json", "b.json", "a.npy"):
        np.testing.assert_array_equal(read_ground_truth(base / name, queries, places), literal)


@pytest.mark.parametrize(
    ("name", "text", "parts"),
    [
        ("t.txt", "", ["t.txt: holds no ground truth; write lines such as 7: 6 7 8"]),
        ("t.txt", "10: 20\n11: x\n", ["t.txt line 2: 'x' is no index"]),
        ("t.txt", "10: 20\n\n11: -4\n", ["t.txt line 3: '-4' is no index"]),
        ("t.txt", "10: 20.5\n", ["t.txt line 1: '20.5' is no index"]),
        ("t.csv", "q,p\nq,p\n10,20\n", ["t.csv line 2: 'q' is no index"]),
        ("t.txt", "10: 20\n,;\n", ["t.txt line 2: ',;' is no index"]),
        ("t.txt", "10: " + "9" * 5000, ["t.txt line 1"]),
        ("t.txt", "0: 20\n1: 21\n", ["t.txt: names no query of this run (10..12); use absolute indices"]),
        ("t.txt", "10: 1\n11: 2\n", ["t.txt: names no place of this run (20..23); use absolute indices"]),
        ("t.json", '{"10": [20],\n "11": ]}', ["t.json line 2: is not JSON"]),
        ("t.json", "3", ["t.json: holds a single value; write"]),
        ("t.json", '{"ten": [20]}', ["t.json: key 'ten' is no index of a query"]),
        ("t.json", '{"10": [20.0]}', ["t.json: query 10 has a place that is no index"]),
        ("t.json", '{"10": [true]}', ["t.json: query 10 has a place that is no index"]),
        ("t.json", '{"10": {"20": 1}}', ["t.json: query 10 has a place"]),
        ("t.json", "[[20], [21]]", ["t.json: has 2 entries for 3 queries (10..12); give one for each of this run"]),
        ("t.json", "[" * 100_000, ["t.json: is not JSON"]),
        ("t.npy", "not numpy", ["t.npy: is no array of numbers", "; save integers (n,)"]),
        ("t.mat", "", ["t.mat: is no known type of ground truth; give a .txt, .csv, .json or .npy file"]),
    ],
)
def test_ground_truth_that_cannot_be_used(tmp_path: Path, name: str, text: str, parts: list[str]) -> None:
    path = written(tmp_path / name, text.encode())
    refused(lambda: read_ground_truth(path, QUERIES, PLACES), *parts)


@pytest.mark.parametrize(
    ("array", "part"),
    [
        (np.array([{"a": 1}], dtype=object), "is no array of numbers"),
        (np.array(["a"]), "is no array of numbers"),
        (np.zeros((2, 2, 2)), "holds float64 (2, 2, 2)"),
        (np.arange(3.0), "holds float64 (3,)"),
        (np.full((3, 4), 2), "holds int64 (3, 4)"),
        (np.zeros((5, 3), dtype=bool), "has 5 entries for 3 queries"),
        (np.zeros((3, 5), dtype=bool), "has 5 entries for 4 places (20..23)"),
        (np.array([1, 2]), "has 2 entries for 3 queries"),
    ],
)
def test_arrays_that_are_no_ground_truth(tmp_path: Path, array: NDArray[np.generic], part: str) -> None:
    np.save(tmp_path / "t.npy", array, allow_pickle=True)
    refused(lambda: read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), "t.npy: ", part)


@pytest.mark.parametrize("spoilt", ["{", "(", ",)", "'<i8'"])
def test_a_damaged_array_header_is_refused(tmp_path: Path, spoilt: str) -> None:
    np.save(tmp_path / "t.npy", QUERIES)
    data = (tmp_path / "t.npy").read_bytes()
    assert spoilt.encode() in data
    path = written(tmp_path / "t.npy", data.replace(spoilt.encode(), b" " * len(spoilt), 1))
    refused(lambda: read_ground_truth(path, QUERIES, PLACES), "t.npy: is no array of numbers")


def test_queries_without_any_place_are_allowed(tmp_path: Path) -> None:
    path = written(tmp_path / "t.txt", b"10:\n11:\n")
    assert not read_ground_truth(path, QUERIES, PLACES).any()
    np.save(tmp_path / "t.npy", np.array([-1, -1, -1]))
    assert not read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES).any()
    refused(lambda: read_ground_truth(tmp_path / "no.npy", QUERIES, PLACES), "no.npy: cannot be read (No such file")
    refused(lambda: read_ground_truth(tmp_path / "no.txt", QUERIES, PLACES), "no.txt: cannot be read (No such file")
