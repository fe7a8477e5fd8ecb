"""Vectors in place of images, through the commands and the public interface."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.commands import PLACES, fails, figures, linked_route, matches, recall, run

from lava_vpr import Localizer, model as model_file, train
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.matching.baselines import cosine_similarities

N, VALUES = 12, 40
QUICK = "[learning]\nepochs = 6\n"


def drives(values: int = VALUES) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """References and, after a season, queries: signed vectors with a common part."""
    rng = np.random.default_rng(3)
    common, own = 4 * rng.normal(size=values), rng.normal(size=(N, values))
    return tuple((common + own + 0.3 * rng.normal(size=own.shape)).astype(np.float32) for _ in range(2))  # type: ignore


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of vectors, the settings ``quick.toml``, and a model ``m.lvpr``."""
    root = tmp_path_factory.mktemp("vectors")
    references, queries = drives()
    np.save(root / "ref.npy", references)
    names, positions = np.array([f"place {k}" for k in range(N)]), np.stack([30.0 * np.arange(N), np.zeros(N)], axis=1)
    np.savez(root / "where.npz", descriptors=references, names=names, positions=positions)
    np.savez(root / "asked.npz", descriptors=queries, positions=positions + 2.0)
    np.save(root / "query.npy", queries.astype(np.float64))
    (root / "quick.toml").write_text(QUICK)
    run("train", root / "ref.npy", "-o", root / "m.lvpr", "--config", root / "quick.toml")
    return root


@pytest.fixture
def route(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    with linked_route(made, tmp_path) as folder:
        yield folder


@pytest.mark.usefixtures("route")
def test_vectors_are_learned_recognised_and_compared() -> None:
    references, queries = drives()
    found = figures("query.npy", "--report", "r")
    assert recall(found) == 1.0
    baselines = found["baselines"]
    assert set(baselines) == {"cosine", "template", "vectors", "standardised"}
    raw = cosine_similarities(references, queries).argmax(axis=1)
    assert recall(found, "vectors") == np.mean(raw == np.arange(N))
    page = Path("r/report.html").read_text(encoding="utf-8")
    for text in ("80 (vector)", "The values of a vector, row by row.", "the vectors as they were given"):
        assert text in page
    told = run("eval", "m.lvpr", "query.npy").stdout
    assert "no sad: the model learned vectors; it compares images" in told
    assert [row["place"] for row in matches("query.npy")] == [str(k) for k in range(N)]
    assert run("query", "m.lvpr", "query.npy", "--places", "4:5").stdout.startswith("vector 000004 may show place 4 ")


@pytest.mark.usefixtures("route")
def test_names_and_positions_beside_vectors_are_known() -> None:
    run("train", "where.npz", "-o", "w.lvpr", "--config", "quick.toml")
    run("eval", "w.lvpr", "asked.npz", "--json", "w.json")
    values = json.loads(Path("w.json").read_text())
    assert values["position_error"]["median_m"] == pytest.approx(8**0.5, abs=0.1)
    run("query", "w.lvpr", "asked.npz", "-o", "w.csv")
    line = Path("w.csv").read_text().splitlines()[3]
    assert line.startswith("2,vector 000002,2,place 2,")
    assert ",60.00,0.00," in line


@pytest.mark.usefixtures("route")
def test_long_vectors_are_projected_with_a_word() -> None:
    references, queries = drives(300)
    np.save("long.npy", references)
    np.save("asked.npy", queries)
    Path("kept.toml").write_text(QUICK + "[encoder]\nvector_kept = 64\n")
    told = run("train", "long.npy", "-o", "long.lvpr", "--config", "kept.toml").stderr
    assert told == (
        "note: vectors of 300 values, standardised on the references, projected on 64 (encoder.vector_kept): "
        "128 inputs\n"
    )
    model = model_file.load(Path("long.lvpr"))
    assert model.standard is not None
    assert model.config.encoder.inputs == 128
    assert model.patches is None
    assert np.array_equal(np.asarray(model.vectors), references)
    run("eval", "long.lvpr", "asked.npy", "--json", "f.json")
    assert recall(json.loads(Path("f.json").read_text())) >= 0.9


@pytest.mark.slow
@pytest.mark.usefixtures("route")
def test_a_deployed_model_gives_every_spike_and_bench_costs_it() -> None:
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "kb", "--calibrate", "query.npy")
    run("deploy", "m.lvpr", "--target", "loihi2", "-o", "l2")
    one = run("query", "m.lvpr", "query.npy", "-o", "-").stdout
    for bundle in ("kb", "l2"):
        assert run("query", bundle, "query.npy", "--backend", "bundle", "-o", "-").stdout.split() == one.split()
    run("bench", "m.lvpr", "query.npy", "--peers", "--backend", "host", "--json", "b.json")
    values = json.loads(Path("b.json").read_text())
    assert not values.get("failed")
    assert list(values["peers"]) == ["lava-vpr", "cosine", "template", "vectors", "standardised"]


@pytest.mark.usefixtures("route")
def test_a_map_of_vectors_grows_and_merges_where_both_measure_alike() -> None:
    run("train", "ref.npy", "--places", "0:7", "-o", "a.lvpr", "--config", "quick.toml")
    run("train", "ref.npy", "--places", "7:12", "-o", "b.lvpr", "--config", "quick.toml", "--standard", "a.lvpr")
    run("train", "ref.npy", "--places", "7:12", "-o", "own.lvpr", "--config", "quick.toml")
    whole = "--parts", "7,5", "--standard", "a.lvpr"
    run("train", "ref.npy", "-o", "all.lvpr", "--config", "quick.toml", *whole)
    run("extend", "a.lvpr", "ref.npy", "--places", "7:12", "-o", "more.lvpr")
    run("merge", "a.lvpr", "b.lvpr", "-o", "both.lvpr")
    assert Path("more.lvpr").read_bytes() == Path("all.lvpr").read_bytes() == Path("both.lvpr").read_bytes()
    said = "own.lvpr: the model measures vectors by references of its own; train it again with --standard"
    assert said in fails("merge", "a.lvpr", "own.lvpr", "-o", "c.lvpr")
    run("remove", "more.lvpr", "3", "-o", "less.lvpr")
    assert np.array_equal(np.asarray(model_file.load(Path("less.lvpr")).vectors), np.delete(drives()[0], 3, axis=0))


@pytest.mark.usefixtures("route")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("eval", "m.lvpr", "narrow.npy"),
            "narrow.npy: holds vectors of 39 values, but the model learned those of 40; ",
        ),
        (
            ("query", "m.lvpr", "images", "-o", "x.csv"),
            "images: holds images, but inputs 'vector' see vectors of 40 values; give a file",
        ),
        (("query", "m.lvpr", "nan.npy"), "nan.npy: row 5 holds NaN or infinite values; compute it again"),
        (("train", "one.npy", "-o", "x.lvpr"), "one.npy: a route needs at least 2 places, but there is 1 image"),
        (("train", "flat.npy", "-o", "x.lvpr"), "flat.npy: all vectors are equal, so nothing tells places apart; "),
        (("train", "ref.npy", "images", "-o", "x.lvpr"), "images: holds images, ref.npy vectors; give one sort"),
        (("train", "ref.npy", "-o", "x.lvpr", "--input", "onoff"), "ref.npy: holds vectors, but inputs 'onoff' see im"),
        (("train", "images", "-o", "x.lvpr", "--input", "vector"), "images: holds images, but inputs 'vector' see vec"),
        (
            ("train", "ref.npy", "-o", "x.lvpr", "--views", "3"),
            "a vector has one view; set views.shifts and views.scales",
        ),
        (
            ("train", "ref.npy", "-o", "x.lvpr", "--preset", "paper"),
            "the conductance network takes encoder.kind 'pixels'",
        ),
        (("train", "ref.npy", "-o", "x.lvpr", "--input", "rates"), "vector 000000: value "),
        (("query", "m.lvpr", "query.npy", "--query-views", "3"), "--query-views is 3, but the model learned vectors"),
        (
            ("eval", "m.lvpr", "query.npy", "--baseline", "sad"),
            "baseline sad: the model learned vectors; it compares im",
        ),
    ],
)
def test_what_does_not_fit_is_one_clear_line(words: tuple[str, ...], message: str) -> None:
    references, _ = drives()
    Path("images").mkdir()
    for k in range(3):
        cv2.imwrite(f"images/{k}.png", np.full((20, 20), 40 * k, np.uint8))
    holed = references.copy()
    holed[5, 7] = np.nan
    np.save("nan.npy", holed)
    np.save("narrow.npy", references[:, 1:])
    np.save("one.npy", references[:1])
    np.save("flat.npy", np.ones((4, 6)))
    assert message in fails(*words)
    assert not Path("x.lvpr").exists()


def test_vectors_in_memory_and_rates_as_they_are() -> None:
    references, queries = drives()
    config = update(preset("loihi"), {"learning": {"epochs": 6}})
    model = train(references, config=config, threads=1)
    robot = Localizer(model, motion="none")
    assert [robot.update(vector).place for vector in queries.astype(np.float64)] == list(range(N))
    robot.add(queries[:2] + 1)
    assert robot.model.places == N + 2
    positive = np.maximum(references - references.mean(axis=0), 0)
    own = train(rates=positive, config=config, threads=1)
    assert own.config.encoder.kind == "rates"
    assert own.standard is None
    assert np.array_equal(own.activity, positive)
    assert Localizer(own, motion="none").update(positive[3]).place == 3
    several = update(config, {"views": {"shifts": 3}})
    wrong: list[tuple[type[Exception], str, Callable[[], object]]] = [
        (InputError, r"has shape \(39,\), but the model learned \(40,\)", lambda: robot.update(queries[0, 1:])),
        (InputError, "vectors: row 0 holds NaN or infinite values", lambda: robot.update(np.full(VALUES, np.nan))),
        (InputError, "rates are at least 0; use the input 'vector'", lambda: train(rates=-positive, config=config)),
        (InputError, "give the images of a route, or rates", lambda: train(references, rates=positive)),
        (InputError, r"vector 1 has shape \(3,\), the first \(40,\)", lambda: train([references[0], np.zeros(3)])),
        (ConfigError, "a vector has one view", lambda: train(references, config=several)),
    ]
    for error, text, call in wrong:
        with pytest.raises(error, match=text):
            call()


@pytest.mark.usefixtures("route")
def test_watch_answers_vectors_and_shows_them() -> None:
    lines = run("watch", "m.lvpr", "query.npy", "--motion", "none").stdout.splitlines()
    assert [json.loads(line)["place"] for line in lines] == list(range(N))
    assert PLACES < N
