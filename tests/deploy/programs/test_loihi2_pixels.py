"""The program of a bundle for Loihi 2 that takes pixels: from these to counts in one run, simulated and on a
stand-in."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.boards.host_programs import answers, pixel_queries
from support.boards.loihi2_bundles import (
    IMAGES,
    SPEC,
    asked,
    environment,
    hearing,
    pictures,
    program,
    write_pixels_bundle,
)

from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.engine.inference.biases import held_biases
from lava_vpr.engine.inference.whole import counts_of
from lava_vpr.loihi import reset_interval

pytestmark = pytest.mark.lava


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle; never written to."""
    return write_pixels_bundle(tmp_path_factory.mktemp("loihi2") / "bundle")


@pytest.mark.parametrize("ways", [(), pytest.param(("--ways", "scalars"), marks=pytest.mark.slow)])
def test_biases_of_each_query_are_written(made: Path, tmp_path: Path, ways: tuple[str, ...]) -> None:
    shown, bias = pictures(3, seed=12), held_biases(np.random.default_rng(4).integers(-4000, 900, (3, 7)))
    folder, env = pixel_queries(tmp_path / "q", shown, bias), environment(options=asked(tmp_path))
    assert program(made, "--queries", folder, "--out", tmp_path / "r", *ways, env=env) == (0, "3 of 3 queries answered")
    counts, _, _ = answers(tmp_path / "r")
    assert np.array_equal(counts, hearing().trains(shown, bias)["exc"].sum(axis=1, dtype=np.int32))
    assert not np.array_equal(counts, counts_of(hearing(), shown))


def test_pictures_of_the_self_test_tell_neurons_apart() -> None:
    counts = counts_of(hearing(), pictures(IMAGES))
    assert len(np.unique(counts, axis=0)) == IMAGES
    assert counts.any(axis=1).tolist() == [True, True, True, True, False]
    assert (SPEC.steps, reset_interval(SPEC.steps)) == (39, 64)


@pytest.mark.slow
def test_lavas_simulation_counts_what_the_host_counts(made: Path, tmp_path: Path) -> None:
    shown = pictures(3, seed=12)
    words = ["--queries", pixel_queries(tmp_path / "q", shown), "--out", tmp_path / "r", "--simulate", "--batch", 2]
    assert program(made, *words) == (0, "3 of 3 queries answered")
    counts, done, _ = answers(tmp_path / "r")
    assert done.all()
    assert counts.any(axis=1)[:2].all()
    assert np.array_equal(counts, counts_of(hearing(), shown))


def test_the_board_counts_what_the_host_counts(made: Path, tmp_path: Path) -> None:
    """All of the network is on the chip; all steps are run, and no more."""
    env = environment(options=asked(tmp_path, log=str(tmp_path / "log")))
    wanted = counts_of(hearing(), pictures(IMAGES))
    said = f"equal: {IMAGES} pictures, {wanted.size} counts, {wanted.sum()} spikes of exc"
    assert program(made, "--self-test", "--batch", 3, env=env) == (0, said)
    parts, ran = (tmp_path / "log").read_text(encoding="utf-8").splitlines()
    kinds = parts.removeprefix("placed ").split(", ")
    assert set(kinds) == {"LIFReset", "NxToPyAdapter", "Sparse"}
    assert (kinds.count("LIFReset"), kinds.count("NxToPyAdapter")) == (len(hearing().populations), 1)
    assert ran == f"ran {IMAGES * 64} steps"


@pytest.mark.slow
@pytest.mark.parametrize(("refuse", "way"), [("arrays", "scalars"), ("reset", "fresh")])
def test_other_ways_cure_a_board(made: Path, tmp_path: Path, refuse: str, way: str) -> None:
    env = environment(options=asked(tmp_path, refuse=[refuse]))
    assert program(made, "--self-test", env=env)[0] == 1
    code, text = program(made, "--self-test", "--ways", way, env=env)
    assert (code, text.split(",")[0]) == (0, f"equal: {IMAGES} pictures")


@pytest.mark.slow
def test_the_ladder_shows_pictures_and_finds_a_way(made: Path, tmp_path: Path) -> None:
    env = environment(options=asked(tmp_path, refuse=["arrays"]))
    code, text = program(made, "--ladder", tmp_path / "ladder.json", env=env)
    assert code == 0, text
    told = json.loads((tmp_path / "ladder.json").read_text(encoding="utf-8"))
    assert [row["name"] for row in told["rungs"]] == ["one reference", "all references"]
    assert (told["passed"], told["ways"]) == (True, ["scalars"])


WRONG = {
    "pixels are not written": ("self.shown(query + 1) if query", "{} if query"),
    "the clock has no bias": ("begin |= self.own | self.shown(0)", "begin |= self.shown(0)"),
    "synapses have no exponent": ("**form | {", '**form | {"weight_exp": 0, '),
    "a presentation is a step short": ("self.go(self.interval)", "self.go(self.interval - 1)"),
}
"""What the program gets wrongly: text, and what becomes of it."""


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_seen_by_the_self_test(made: Path, tmp_path: Path, name: str) -> None:
    read, (old, new) = bundle_folder.load(made), WRONG[name]
    content = read.files["program/lava_pixels.py"].decode()
    assert old in content
    files = {**read.files, "program/lava_pixels.py": content.replace(old, new).encode()}
    told = {key: read.manifest[key] for key in ("target", "network", "front_end")}
    bundle_folder.write(tmp_path / "bundle", told, files)
    code, text = program(tmp_path / "bundle", "--self-test", 2, env=environment())
    assert code == 1
    assert text.startswith("queries 0 to 1: the read-out covers 126" if "short" in name else "self-test: neuron"), text


def test_what_does_not_fit_is_refused(made: Path, tmp_path: Path) -> None:
    shown = pictures(2)
    for number, (given, said) in enumerate(
        (
            (shown.astype(np.int32), "pixels.npy is int32 (2, 4, 8), but must be uint8 (n, 4, 8)"),
            (shown[:, 1:], "pixels.npy is uint8 (2, 3, 8), but must be uint8 (n, 4, 8)"),
        )
    ):
        folder = pixel_queries(tmp_path / f"q{number}", given)
        code, text = program(made, "--queries", folder, "--out", tmp_path / "r", "--simulate")
        assert (code, text) == (1, f"{folder}: {said}")
    folder = pixel_queries(tmp_path / "q", shown)
    words = ["--queries", folder, "--out", tmp_path / "r", "--power", tmp_path / "p.json"]
    code, text = program(made, *words, env=environment())
    assert (code, text) == (
        1,
        "--power needs all queries in one run, but the pixels of this bundle are written between runs; leave out "
        "--power",
    )


def test_check_tells_what_is_there(made: Path) -> None:
    code, text = program(made, "--check", "--simulate")
    assert code == 0
    assert text.splitlines()[1] == "ready: 7 neurons, 32 cells that they hear; lava-nc 0.10.0, simulated"
