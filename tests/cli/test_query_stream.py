"""`lava-vpr query` takes images as they come: memory, answers and files do not depend on how many there are."""

from __future__ import annotations

import csv
import dataclasses
import io
import os
import resource
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.common.commands import fails, images, listed, matches, run

from lava_vpr import model as model_file
from lava_vpr.backends import answering
from lava_vpr.backends.answering import answer_stream
from lava_vpr.backends.asking import calibration_of
from lava_vpr.backends.interface import HostBackend
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cli.outputs import text_writer
from lava_vpr.encoding import encode_traverse
from lava_vpr.errors import InputError
from lava_vpr.matching.answers import answers_of
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.matching.sequences import sequence_scores
from lava_vpr.model import Model, decode
from lava_vpr.recognition import count_query_spikes
from lava_vpr.traverse import open_traverse

QUERIES = 21


def shown_together(monkeypatch: pytest.MonkeyPatch, together: int, batch: int = 4) -> None:
    """So many images are encoded as a ``batch``, and ``together`` shown to the network in one call."""
    monkeypatch.setattr(answering, "BATCH", batch)
    row = dataclasses.replace(BACKENDS["host"], together=together)
    monkeypatch.setattr(answering, "BACKENDS", {**BACKENDS, "host": row})


@pytest.fixture
def few_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many batches of a few queries each."""
    shown_together(monkeypatch, 8)


@pytest.fixture
def many(here: Path) -> str:
    """A list that names the images of the route in no order, again and again, one of them blank."""
    cv2.imwrite("blank.png", np.full((48, 64, 3), 90, np.uint8))
    files = [*images("query"), Path("blank.png")]
    listed("many.txt", [files[k] for k in np.random.default_rng(0).integers(0, len(files), QUERIES)])
    return "many.txt"


def literal(model: Model, source: str, sequence: int, places: tuple[int, int], seed: int | None) -> str:
    """The CSV of all queries at once: every image, then every spike count, then one matrix of scores."""
    queries = encode_traverse(open_traverse(source, places=places), model.config.encoder)
    counts, _ = count_query_spikes(model, queries, seed=seed)
    name = model.config.decoder.default
    scores = decode(model, counts, name)
    calibration = calibration_of(model)
    assert calibration is not None
    least = calibration.keeping(0.95).probability
    first, windows = 0, answers_of(name, scores, calibration)
    if sequence > 1:
        first, windows = sequence - 1, answers_of("sequence", sequence_scores(scores, sequence))
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(("query", "query_name", "place", "place_name", "confidence", "accepted", "probability"))
    for k, (index, query) in enumerate(zip(queries.indices, queries.names, strict=True)):
        match = windows.matches[k - first] if k >= first else -1
        if match < 0:
            writer.writerow((index, query, -1, "", "", "false", ""))
        else:
            sure, place = float(windows.confidence[k - first]), match + first
            where = (model.place_indices[place], model.place_names[place])
            chance = windows.probability[k - first]
            known = ("false", "") if sequence > 1 else (str(chance >= least).lower(), f"{chance:.6f}")
            writer.writerow((index, query, *where, repr(sure), *known))
    return file.getvalue()


@pytest.mark.parametrize("sequence", [1, 2, 3, 5, 8])
@pytest.mark.parametrize("decoder", DECODERS)
def test_the_answers_are_those_of_all_queries_at_once(
    decoder: str, sequence: int, many: str, few_at_a_time: None
) -> None:
    model = model_file.load("m.lvpr")
    default = dataclasses.replace(model.config.decoder, default=decoder)
    model = dataclasses.replace(model, config=dataclasses.replace(model.config, decoder=default))
    model_file.save(model, Path("other.lvpr"))
    words = ("--sequence", sequence, "--places", "2:20", "--seed", 3)
    run("query", "other.lvpr", many, "-o", "q.csv", *words)
    assert Path("q.csv").read_text() == literal(model, many, sequence, (2, 20), 3)


def test_an_image_alone_is_answered_as_in_its_folder(here: Path) -> None:
    whole = matches("query")
    assert len({row["confidence"] for row in whole}) > len(whole) // 2
    for row, path in zip(whole, images("query"), strict=True):
        (alone,) = matches(path)
        assert alone == row | {"query": "0"}
    backwards = matches(listed("backwards.txt", images("query")[::-1]))
    assert [row | {"query": ""} for row in backwards[::-1]] == [row | {"query": ""} for row in whole]


def test_few_images_are_read_before_their_answers_come(many: str, few_at_a_time: None) -> None:
    model, read, sizes = model_file.load("m.lvpr"), 0, []

    def one_more(done: int) -> None:
        nonlocal read
        read += done

    for answered in answer_stream(model, open_traverse(many), read=one_more):
        sizes.append(len(answered.images))
        assert read == min(QUERIES, -(-sum(sizes) // 8) * 8)
    assert sizes == [4, 4, 4, 4, 4, 1]


@pytest.mark.parametrize("together", [1, 4, 8, 9, 8192])
def test_a_backend_that_is_slow_to_start_is_shown_many_at_once(
    together: int, many: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[int] = []

    class Counting(HostBackend):
        def count_spikes(self, model, shown):  # type: ignore[no-untyped-def]
            calls.append(len(shown.rates))
            return super().count_spikes(model, shown)

    shown_together(monkeypatch, together)
    monkeypatch.setattr(answering.backends, "get", lambda name, threads, advance: Counting())
    assert sum(len(some.images) for some in answer_stream(model_file.load("m.lvpr"), open_traverse(many))) == QUERIES
    wanted = {1: [4] * 5 + [1], 4: [4] * 5 + [1], 8: [8, 8, 5], 9: [8, 8, 5], 8192: [QUERIES]}
    assert calls == wanted[together]
    assert all(row.together >= 4096 for name, row in BACKENDS.items() if name != "host")


def peak(count: int) -> int:
    """Bytes of Python's and numpy's that a query for ``count`` images held at most."""
    listed(f"{count}.txt", [Path(f"small{k % 3}.png") for k in range(count)])
    tracemalloc.start()
    try:
        run("query", "m.lvpr", f"{count}.txt", "-o", "q.csv", "--sequence", 3)
        held = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(Path("q.csv").read_text().splitlines()) == count + 1
    return held


def test_memory_does_not_grow_with_the_number_of_images(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Path and number stay, here 84 bytes; activity (6,272), rates, counts, scores and rows go."""
    shown_together(monkeypatch, 50, batch=50)
    for k in range(3):
        cv2.imwrite(f"small{k}.png", np.random.default_rng(k).integers(0, 256, (24, 32)).astype(np.uint8))
    peak(3)  # what is imported and compiled at the first call is no cost of the images
    few, more = peak(200), peak(3200)  # so many that garbage not yet collected, up to 60 kB, counts little
    assert (more - few) / 3000 < 120


@pytest.fixture
def kept(many: str) -> Iterator[None]:
    """An output that exists; whatever fails leaves it as it was, and nothing beside it. There is a damaged image."""
    Path("damaged.png").write_bytes(images("query")[0].read_bytes()[:-40])
    Path("q.csv").write_text("mine\n")
    before = sorted(os.listdir())
    yield
    assert Path("q.csv").read_text() == "mine\n"
    assert sorted(os.listdir()) == before


def test_an_image_late_in_the_list_that_cannot_be_read(many: str, few_at_a_time: None, kept: None) -> None:
    with Path(many).open("a") as file:
        file.write("damaged.png\n")
    assert fails("query", "m.lvpr", many, "-o", "q.csv").startswith("damaged.png: ")


def test_a_disk_that_is_full_in_the_middle(many: str, few_at_a_time: None, kept: None) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, limits[1]))
    try:
        line = fails("query", "m.lvpr", many, "-o", "q.csv")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert line == "q.csv: cannot be written (File too large); free space or choose another place"


def test_a_text_has_no_name_until_it_is_whole(tmp_path: Path) -> None:
    """Whatever ends the process leaves nothing."""
    with text_writer(tmp_path / "a.csv") as write:
        write("one\n" * 100_000)
        assert not os.listdir(tmp_path)
        write("two\n")
    assert (tmp_path / "a.csv").read_text() == "one\n" * 100_000 + "two\n"

    def fail() -> None:
        with text_writer(tmp_path / "a.csv") as write:
            write("three\n")
            raise InputError("reading went wrong")

    with pytest.raises(InputError, match="reading went wrong"):
        fail()
    assert (tmp_path / "a.csv").read_text().endswith("two\n")
    assert os.listdir(tmp_path) == ["a.csv"]
