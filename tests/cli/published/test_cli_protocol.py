"""``lava-vpr protocol``, on drawn images under the publishers' names."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.common.benchmarkfolders import place
from support.common.commands import SHORT, fails, run

from lava_vpr.config import preset
from lava_vpr.datasets.protocol_rows import PROTOCOLS
from lava_vpr.datasets.protocols import ANY, Names, ProtocolLayout
from lava_vpr.modelfile import check_model

FEW = 4
"""Queries of each protocol, by section."""


def _first(side: tuple[Names, ...], images: int) -> tuple[Names, ...]:
    """The first images of each folder."""
    kept = []
    for names in side:
        numbers = [k for some in names.numbers for k in some][:images]
        kept.append(replace(names, numbers=tuple(range(k, k + 1) for k in numbers)))
    return tuple(kept)


@pytest.fixture
def short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """All protocols with a few images, in an empty folder with settings ``quick.toml``."""
    monkeypatch.chdir(tmp_path)
    Path("quick.toml").write_text(SHORT)
    rows = list(PROTOCOLS.values())
    try:
        for row in rows:
            PROTOCOLS.remove(row.name)
            layouts = (
                replace(
                    one,
                    references=_first(one.references, FEW * row.every - (row.every - 1)),
                    queries=_first(one.queries, FEW),
                )
                for one in row.layouts
            )
            PROTOCOLS.register(replace(row, layouts=tuple(layouts)))
        yield
    finally:
        for row in rows:
            PROTOCOLS.remove(row.name)
            PROTOCOLS.register(row)


def draw(root: Path, layout: ProtocolLayout, every: int) -> None:
    """The images of a layout: reference k shows place k, query k place k times ``every``, in another season."""
    for side, look, step in ((layout.references, "summer", 1), (layout.queries, "winter", every)):
        number = 0
        for names in side:
            folder = root / names.folder
            folder.mkdir(parents=True)
            for name in names.listed() or [f"Image{k:03d}.jpg" for k in range(len(names))]:
                cv2.imwrite(str(folder / name), place(number * step, look))
                number += 1
    if layout.truth is not None:
        np.save(root / layout.truth, np.eye(FEW))


def figures(file: str) -> dict[str, object]:
    return dict(json.loads(Path(file).read_text())["decoders"])


SLOW = pytest.mark.slow
EACH = [
    pytest.param(name, number, marks=() if (name, number) in {("nordland-2760", 1), ("lens", 0)} else SLOW)
    for name, row in PROTOCOLS.items()
    for number in range(len(row.layouts))
]


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize(("name", "number"), EACH)
def test_recall_is_what_eval_gives_with_that_tolerance(name: str, number: int) -> None:
    row = PROTOCOLS[name]
    layout = row.layouts[number]
    draw(Path("images"), layout, row.every)
    told = run("protocol", name, "images", "-o", "out", "--config", "quick.toml").stdout
    assert f"{row.title}: {row.sizes[0]} learned, {row.sizes[1]} recognised\n" in told
    assert "a part" not in told
    for one in row.published:
        assert one.method in told
    sources = []
    for side, which in ((layout.references, "references"), (layout.queries, "queries")):
        folders = [str(Path("images", names.folder).resolve()) for names in side]
        Path(f"{which}.txt").write_text("".join(f"{file}\n" for f in folders for file in sorted_images(f)))
        assert Path("out", f"{which}.txt").read_text() == Path(f"{which}.txt").read_text()
        sources.append(f"{which}.txt")
    run("train", sources[0], "-o", "m.lvpr", "--config", "quick.toml", *row.learn)
    Path("gt.txt").write_text("".join(f"{k}: {k * row.every}\n" for k in range(row.sizes[1])))
    run("eval", "m.lvpr", sources[1], "--gt", "gt.txt", "--tolerance", row.tolerance, "--json", "f.json")
    assert figures("out/eval.json") == figures("f.json")
    decoder = json.loads(Path("f.json").read_text())["default_decoder"]
    recall = figures("f.json")[decoder]["recall_at_1"]  # type: ignore[index]
    assert re.search(rf"│ {decoder} +│ +{100 * recall:.1f} │", told)
    assert re.search(rf"│ {decoder} +│.* 64 x 64 │", told)


def sorted_images(folder: str) -> list[str]:
    """The images of a folder by the number in their names, which have one."""
    return sorted(map(str, Path(folder).iterdir()), key=lambda path: int("".join(filter(str.isdigit, Path(path).name))))


def test_the_names_are_those_of_the_publishers_lists() -> None:
    """Literal hashes, of the lists that the sources hold."""
    first = {name: row.layouts[0] for name, row in PROTOCOLS.items()}
    kept = "5f74d2dc7bb3ad4a452ec722c47482fb9d95ab3e0f15513b6ddf437157f914c2"
    for side in (first["nordland-27592"].references, first["nordland-27592"].queries):
        assert [(len(names), names.sha256) for names in side] == [(27_592, kept)]
    assert PROTOCOLS["nordland-2760"].layouts[1].references[0].sha256 == kept
    vpr_bench = {
        "nordland-2760": (
            "fe670a9ec52173d284db2d7c493fd1c5e768d27f0ea6904651f4ae57cdf8bcd9",
            "666f398a9193b9c29e4aa0b9af915cf25896906832bdfb414f8beb9295463011",
        ),
        "sped": ("4eabfc97ab65a188f94d2fc7a01b5b79fb7a27258843b6ca15af2d1f20361c3e",) * 2,
    }
    for name, hashes in vpr_bench.items():
        sides = (first[name].references[0], first[name].queries[0])
        assert tuple(names.sha256 for names in sides) == hashes
    sections = first["nordland-3450"].queries
    assert [(names.listed()[0], names.listed()[-1]) for names in sections] == [
        ("0.png", "1149.png"),
        ("1150.png", "2299.png"),
        ("2300.png", "3449.png"),
    ]


def test_each_figure_and_each_protocol_has_a_source() -> None:
    for row in PROTOCOLS.values():
        told = run("protocol", row.name).stdout
        for text in (row.title, row.page, row.unsaid, *row.sources):
            assert text in told
        assert all(source.startswith("https://") for source in (*row.sources, *(one.source for one in row.published)))
    listed = run("protocol").stdout
    assert all(name in listed for name in PROTOCOLS)
    assert "27,592" in listed


def test_each_protocol_is_within_the_limits() -> None:
    """Nordland's 27,592 places are the most that a protocol learns."""
    for row in PROTOCOLS.values():
        check_model(preset("loihi"), row.sizes[0], 1, row.sizes[0])


@pytest.mark.usefixtures("short")
def test_what_is_missing_is_one_line() -> None:
    row = PROTOCOLS["nordland-2760"]
    Path("images").mkdir()
    said = fails("protocol", row.name, "images", "-o", "out")
    assert (
        "images: does not hold the images of nordland-2760; it needs ref (missing) + query (missing), or nordland"
        in said
    )
    assert said.endswith(f"get them from {row.page}")
    draw(Path("images"), row.layouts[0], row.every)
    ask = ("protocol", row.name, "images", "-o", "out")
    Path("images/ref/0000005.jpg").unlink()
    assert "images/ref: holds 30 of the 31 images of nordland-2760 (0000005.jpg is the first that is missing)" in fails(
        *ask
    )
    Path("images/ref/0000010.jpg").unlink()
    assert "images/query/0000001.jpg: shows a place of which there is no reference" in fails(*ask, "--part")
    Path("images/query/0000001.jpg").unlink()
    assert not Path("out").exists()
    told = run(*ask, "--part", "--config", "quick.toml").stdout
    assert "29 learned, 3 recognised; a part: the protocol has 31 and 4, so these are not its figures" in told
    # Right are the neighbours by the publisher's list, not by what is there: 9 and 11 of 10, were it asked for.
    assert json.loads(Path("out/truth.json").read_text()) == {"0": [0, 1], "1": [17, 18, 19], "2": [27, 28]}
    run(*ask, "--part", "--config", "quick.toml")  # the same lists: the folder is taken again
    queries = Path("out/queries.txt")
    queries.write_text("mine\n")
    assert "out: exists, and does not hold the lists of this protocol; name a new folder" in fails(*ask, "--part")
    assert queries.read_text() == "mine\n"
    for image in Path("images/ref").iterdir():
        image.unlink()
    assert "images/ref: holds no images" in fails(*ask, "--part")
    assert "name it with --output DIR" in fails("protocol", row.name, "images", code=2)


@pytest.mark.usefixtures("short")
def test_folders_of_any_names_hold_as_many_as_the_publisher_s() -> None:
    row = PROTOCOLS["gardens-point"]
    assert row.layouts[0].references[0].name == ANY
    draw(Path("images"), row.layouts[0], 1)
    ask = ("protocol", row.name, "images", "-o", "out")
    shutil.copy("images/ref/Image000.jpg", "images/ref/Image004.jpg")
    assert "images/ref: holds 5 images, the protocol 4; take out those" in fails(*ask)
    for k in (3, 4):
        Path(f"images/ref/Image00{k}.jpg").unlink()
    assert "images/ref: holds 3 of the 4 images of gardens-point; complete them from https://" in fails(*ask)
