"""The loop from a source to answers: it holds nothing of images that are answered, and starts no thread."""

from __future__ import annotations

import gc
import threading
import tracemalloc
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from lava_vpr import Localizer
from lava_vpr.errors import InputError
from lava_vpr.images.imagefiles import read_image
from lava_vpr.readers import Frame
from lava_vpr.watch.watching import watch


@pytest.fixture
def localizer(made: Path) -> Localizer:
    """One that knows the synthetic route."""
    return Localizer(made / "m.lvpr")


@pytest.fixture(scope="module")
def pictures(made: Path) -> list[np.ndarray]:
    """The queries of the route."""
    return [read_image(path) for path in sorted((made / "query").iterdir())]


def endless(images: list[np.ndarray]) -> Iterator[Frame]:
    """The images again and again, one in five of them unreadable."""
    number = 0
    while True:
        image = InputError("no") if number % 5 == 4 else images[number % len(images)]
        yield Frame(f"image {number}", float(number), image)
        number += 1


@pytest.mark.slow
def test_memory_is_steady_and_no_thread_is_started(localizer: Localizer, pictures: list[np.ndarray]) -> None:
    refused: list[int] = []
    answers = watch(localizer, endless(pictures), lambda index, why: refused.append(index))
    held, alive = [], threading.active_count()
    tracemalloc.start()
    try:
        for _ in range(3):
            for _ in islice(answers, 200):
                pass
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0] - 60 * len(refused))
    finally:
        tracemalloc.stop()
    assert held[2] - held[1] < 40_000  # an image held would take 9,216 bytes, 200 times
    assert threading.active_count() == alive
    assert refused[:2] == [4, 9]


def test_an_image_that_cannot_be_answered_is_left_out(localizer: Localizer, pictures: list[np.ndarray]) -> None:
    bad = np.zeros((4, 4), np.float32)
    refused: list[tuple[int, str]] = []
    source = [Frame("a", None, pictures[0]), Frame("b", None, bad), Frame("c", None, pictures[1])]
    found = list(watch(localizer, source, lambda index, why: refused.append((index, str(why)))))
    assert [one.index for one in found] == [0, 2]
    assert refused[0][0] == 1
    assert "float32" in refused[0][1]
