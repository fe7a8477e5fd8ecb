"""Images, lists, videos and truth that a user may name by mistake, or an enemy on purpose, as commands answer them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from support.common.commands import matches

from lava_vpr.cli import main


def fails(*words: object) -> Result:
    """A command that ends in one line on stderr and exit code 1."""
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == 1, result.output
    assert result.stderr.startswith("lava-vpr: error: "), result.stderr
    assert result.stderr.count("\n") == 1, result.stderr
    return result


def test_a_pattern_of_images_is_no_list_of_traverses(here: Path) -> None:
    images = sorted(Path("reference").iterdir())
    text = fails("train", *images, "-o", "new.lvpr", "--config", "quick.toml").stderr
    assert text == (
        f"lava-vpr: error: {images[0]}: is one of 8 references, but a single image; give the folder reference instead "
        "of the images in it, or a list of them\n"
    )
    fails("train", "reference", images[0], "-o", "new.lvpr", "--config", "quick.toml")
    assert not Path("new.lvpr").exists()


@pytest.mark.parametrize("command", ["query", "eval", "bench", "verify"])
def test_a_pattern_of_query_images_is_told_to_be_their_folder(here: Path, command: str) -> None:
    images = sorted(map(str, Path("query").iterdir()))
    output = ["-o", "q.csv"] if command == "query" else []
    result = CliRunner().invoke(main, [command, "m.lvpr", *images, *output])
    assert result.exit_code == 2
    why = (
        f"Error: {images[1]!r} is one argument too many (7 are); give the folder instead of the images in it, or a list"
    )
    assert why in result.stderr, result.stderr


def test_names_that_hold_line_ends_come_back_from_the_answers(here: Path) -> None:
    names = ["a\rb.png", "a\nb.png", "a\r\nb.png"]
    Path("odd").mkdir()
    for name in names:
        os.symlink(Path("query/place_00000.png").resolve(), Path("odd") / name)
    assert {row["query_name"] for row in matches("odd")} == set(names)
