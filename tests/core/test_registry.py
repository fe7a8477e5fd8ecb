"""Registries keep rows by name, in order; rows of other packages are found by entry points, and loaded when asked for.

One that is broken is left out with a line.
"""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.imagefiles import image_bytes, watched, write_images, written
from support.common.plugins import READER, Install

from lava_vpr.cli import main
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.readers import READERS
from lava_vpr.rows import registry as registries
from lava_vpr.rows.registry import Registry
from lava_vpr.traverse import open_traverse


@dataclass(frozen=True)
class Shape:
    """A row."""

    name: str
    corners: int


SQUARE = Shape("square", 4)


def shapes() -> Registry[Shape]:
    registry: Registry[Shape] = Registry("shape", ConfigError)
    registry.register(SQUARE)
    return registry


def test_rows_are_kept_by_name_in_the_order_of_registration() -> None:
    registry = shapes()
    circle = registry.register(replace(SQUARE, name="circle"))
    triangle = registry.register(replace(SQUARE, name="a triangle"))
    assert list(registry) == ["square", "circle", "a triangle"]
    assert list(registry.values()) == [SQUARE, circle, triangle]
    assert registry["circle"] is circle
    assert ("circle" in registry, "ring" in registry, len(registry)) == (True, False, 3)
    assert (registry.get("circle"), registry.get("ring")) == (circle, None)


def test_an_unknown_name_is_one_line_that_lists_the_known_ones() -> None:
    registry = shapes()
    registry.register(replace(SQUARE, name="circle"))
    with pytest.raises(ConfigError, match=r"^there is no shape 'ring'; choose from square, circle$"):
        registry["ring"]
    with pytest.raises(ConfigError, match="there is no shape 'ring'"):
        registry.remove("ring")


def test_two_rows_of_one_name_are_refused_until_the_first_is_removed() -> None:
    registry = shapes()
    with pytest.raises(ValueError, match="shape 'square' is registered twice"):
        registry.register(replace(SQUARE, corners=5))
    assert registry["square"].corners == 4
    registry.remove("square")
    registry.register(replace(SQUARE, corners=5))
    assert registry["square"].corners == 5


SHAPES = """
from {test} import Shape
SQUARE, RING, OTHER = Shape("square", 4), Shape("ring", 0), "no shape"
"""

LIVE = """
import numpy as np
from lava_vpr.images.sampling import Sample
from lava_vpr.readers import Found, Reader

def found(wanted):
    sample = Sample(0, wanted.every, lambda: np.zeros((40, 40), np.uint8), name=wanted.source)
    return Found(walk=lambda: iter([sample]))

ARM = Reader("arm", "a robot's arm", found, named=lambda source: source.startswith("arm:"))
"""


def with_plugins(monkeypatch: pytest.MonkeyPatch) -> Registry[Shape]:
    """A registry of shapes that takes plug-ins, and the name under which they import `Shape`."""
    monkeypatch.setitem(sys.modules, "plugged_shapes", sys.modules[__name__])
    made = Registry[Shape]("shape", ConfigError, group="lava_vpr.shapes", row_class=Shape)
    made.register(Shape("circle", 0))
    return made


CODE = SHAPES.format(test="plugged_shapes")


def test_rows_are_loaded_when_they_are_asked_for(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = with_plugins(monkeypatch)
    install("angular", "lava_vpr.shapes", {"square": "SQUARE", "ring": "RING"}, CODE)
    assert "square" in rows
    assert "cube" not in rows
    assert rows.names() == ("circle", "ring", "square")
    assert "angular" not in sys.modules
    assert rows["square"].corners == 4
    assert [row.name for row in rows.values()] == list(rows) == ["circle", "ring", "square"]
    assert len(rows) == 3
    assert rows.get("square") is rows["square"]
    assert rows.get("cube") is None
    with pytest.raises(
        ConfigError, match=r"^there is no shape 'cube'; choose from circle, ring, square, or install the "
    ):
        rows["cube"]
    ((ring, _), (square, reason)) = rows.plugged()
    assert (square.name, square.package, square.version, reason) == ("square", "angular", "1.2", None)
    assert ring.origin == "the package angular 1.2"


def test_what_is_built_in_needs_no_look_at_packages(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    def never() -> None:
        raise AssertionError("packages were looked at")

    with monkeypatch.context() as patch:
        patch.setattr(registries, "scanned", never)
        assert DECODERS["contrast"].name == "contrast"
        assert INPUTS.get("orientation") is INPUTS["orientation"]
        assert "image" in READERS
        with pytest.raises(AssertionError, match="packages were looked at"):
            DECODERS.names()


BROKEN = [
    ({"ring": "MISSING"}, CODE, r"cannot be loaded \(AttributeError: .*MISSING'?\)"),
    (
        {"ring": "RING"},
        "import nothing_of_that_name",
        r"cannot be loaded \(ModuleNotFoundError: .*'nothing_of_that_name'\)",
    ),
    ({"ring": "RING"}, "raise SystemExit(3)", r"cannot be loaded \(SystemExit: 3\)"),
    (
        {"ring": "RING"},
        "class Odd(BaseException): pass\nraise Odd('no')",
        r"cannot be loaded \(Odd: no\)",
    ),
    ({"ring": "OTHER"}, CODE, "is str instead of a row of type Shape"),
    ({"ring": "SQUARE"}, CODE, "calls itself 'square'"),
]


@pytest.mark.parametrize(("entries", "code", "said"), BROKEN)
def test_a_broken_one_costs_a_line(
    install: Install,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    entries: dict[str, str],
    code: str,
    said: str,
) -> None:
    """A warning where all rows are asked for, an error where it is asked for by name; all others work."""
    rows, (name,) = with_plugins(monkeypatch), entries
    install("broken", "lava_vpr.shapes", entries, code)
    with caplog.at_level(logging.WARNING, "lava_vpr"):
        assert list(rows) == list(rows) == ["circle"]
    (record,) = caplog.records
    line = rf"^shape '{name}' of the package broken 1\.2 {said}; update or uninstall that package$"
    with pytest.raises(ConfigError, match=line) as caught:
        rows[name]
    assert record.getMessage() == str(caught.value)
    ((_, reason),) = rows.plugged()
    assert reason == str(caught.value)


def test_a_name_that_is_taken_is_left_out(
    install: Install, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    rows = with_plugins(monkeypatch)
    install("later", "lava_vpr.shapes", {"circle": "RING", "ring": "SQUARE"}, CODE)
    install("first", "lava_vpr.shapes", {"ring": "RING"}, CODE)
    with caplog.at_level(logging.WARNING, "lava_vpr"):
        assert list(rows) == ["circle", "ring"]
    assert rows["circle"].corners == 0
    assert rows["ring"].name == "ring"
    end = "has a shape of that name; uninstall one, or rename it"
    assert [record.getMessage() for record in caplog.records] == [
        f"shape 'circle' of the package later 1.2 is left out: this program itself {end}",
        f"shape 'ring' of the package later 1.2 is left out: the package first 1.2 {end}",
    ]
    assert [reason is None for _, reason in rows.plugged()] == [True, False, False]


def test_unreadable_metadata_brings_nothing(install: Install, tmp_path: Path) -> None:
    install("odd", "lava_vpr.shapes", {})
    for text in (b"\xff\xfe lava_vpr.shapes", b"lava_vpr.shapes\n= = =\n[", b"[lava_vpr.shapes\nx"):
        (tmp_path / "site" / "odd-1.2.dist-info" / "entry_points.txt").write_bytes(text)
        registries.scanned.cache_clear()
        assert all(plugin.package != "odd" or plugin.name for plugin in registries.scanned())


def test_a_reader_of_a_package_is_a_source_of_every_command(install: Install, tmp_path: Path) -> None:
    (tmp_path / "a.scan").touch()
    known = r"\.bmp \.tif \.tiff \.webp \.heic \.heif \.hif"
    with pytest.raises(InputError, match=rf"a\.scan: is of no known type; .* {known}$"):
        open_traverse(tmp_path / "a.scan")
    install("lidar", "lava_vpr.readers", {"scans": "SCANS"}, READER)
    traverse = open_traverse(tmp_path / "a.scan", places=(2, 5), every=0.5)
    assert traverse.names == ("scan 000002", "scan 000003", "scan 000004")
    assert [int(image[0, 0]) for image in traverse.images()] == [2, 3, 4]
    assert int(traverse.load(1)[0, 0]) == 3
    assert traverse.stamps is not None
    np.testing.assert_array_equal(traverse.stamps, [1.0, 1.5, 2.0])
    seen = list(watched(tmp_path / "a.scan", every=0.5))
    assert [(one.name, one.stamp) for one in seen[:2]] == [("scan 000000", 0.0), ("scan 000001", 0.5)]
    assert len(seen) == 9  # watched, it goes on
    written(tmp_path / "b.png", image_bytes(".png", np.zeros((40, 40), np.uint8)))
    assert open_traverse(tmp_path / "b.png").names == ("b.png",)
    install("robot", "lava_vpr.readers", {"arm": "ARM"}, LIVE)
    (live,) = watched("arm:3", every=0.25)
    assert (live.name, live.stamp, live.image.shape) == ("arm:3", 0.25, (40, 40))
    with pytest.raises(InputError, match=r"^arm:3: is a robot's arm, which can only be watched; use lava-vpr watch$"):
        open_traverse("arm:3")
    (tmp_path / "a.text").touch()
    with pytest.raises(InputError, match=rf"a\.text: is of no known type; .* {known} \.scan$"):
        open_traverse(tmp_path / "a.text")
    assert "scans" in READERS


def test_commands_know_them_and_doctor_lists_them(install: Install, tmp_path: Path) -> None:
    install("lidar", "lava_vpr.readers", {"scans": "SCANS"}, READER)
    install("worse", "lava_vpr.inputs", {"radar": "NONE"})
    assert "radar" in CliRunner().invoke(main, ["train", "--help"]).stdout
    result = CliRunner().invoke(main, ["doctor"])
    assert result.exit_code == 0, result.output
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in result.stdout.splitlines() if "│" in line]
    assert ["reader", "scans", "lidar", "1.2", "yes"] in rows
    assert any(row[:4] == ["kind of input", "radar", "worse", "1.2"] for row in rows)
    assert "AttributeError" in result.stdout
    failed = CliRunner().invoke(
        main, ["train", str(write_images(tmp_path / "drive")), "-o", str(tmp_path / "m.lvpr"), "--input", "radar"]
    )
    assert failed.exit_code == 1
    assert "kind of input 'radar' of the package worse 1.2 cannot be loaded (AttributeError" in failed.stderr
