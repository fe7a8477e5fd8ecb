"""The page of ``query --report``: pairs without ground truth, of any number, in a real browser and on a phone."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from support.common.browser import PHONE, acted, on_phone, visit

from lava_vpr.report.answers import AnswersData, page
from lava_vpr.report.data import MapData

UNMATCHED, UNSURE = 3, 5


def example(n: int = 70, places: int = 40, **changes: Any) -> AnswersData:
    """``n`` images in driving order, half of them accepted; one matches nothing."""
    images = np.random.default_rng(1).integers(0, 256, (n + places, 12, 16, 3), dtype=np.uint8)
    thumbnails = np.stack([cv2.resize(image, (64, 48)) for image in images]).astype(np.uint8)
    matches, probability = np.arange(n) * places // n, np.linspace(0.2, 0.99, n)
    matches[UNMATCHED], probability[UNSURE] = -1, 0.01
    accepted = (probability > 0.595) & (matches >= 0)
    along = np.stack([np.arange(places) * 3.0, np.zeros(places)], axis=1)
    data = AnswersData(
        command="lava-vpr query route.lvpr today --motion any",
        summary={"map": f"{places} places"},
        query_names=tuple(f"q{k:04}.png" for k in range(n)),
        query_numbers=np.arange(n) + 100,
        query_thumbnails=thumbnails[:n],
        place_names=tuple(f"r{k:04}.png" for k in range(places)),
        place_numbers=np.arange(places),
        place_thumbnails=thumbnails[n:],
        matches=matches,
        accepted=accepted,
        probability=probability,
        confidence=np.where(matches >= 0, 2.0, -np.inf),
        least=0.595,
        off_map=1 - probability,
        followed=probability,
        map=MapData(along, along[np.maximum(matches, 0)], ""),
    )
    return dataclasses.replace(data, **changes)


def test_a_thousand_places_stay_below_two_megabytes() -> None:
    size = len(page(example(1000, 1000)).encode())
    assert 500_000 < size < 2_000_000


def test_what_is_not_known_is_not_shown() -> None:
    text = page(example(off_map=None, followed=None, map=None))
    assert ("#drive" in text, "#map" in text, "#pairs" in text) == (False, False, True)
    assert 'Accepted <b class="num">35 of 70</b> images' in text
    assert "a probability of 59.5 % or more" in text
    unknown = page(example(probability=np.full(70, np.nan), least=np.nan))
    assert "The probability of these matches is not known." in unknown
    assert "confidence, highest first" in unknown
    nothing = example(matches=np.full(70, -1), accepted=np.zeros(70, np.bool_), least=np.inf)
    assert "No probability is high enough for the precision" in page(nothing)


def test_images_that_something_speaks_against_are_told() -> None:
    data = example()
    assert "doubtful" not in page(data)
    accepted = data.accepted.copy()
    accepted[-3:] = False
    text = page(dataclasses.replace(data, accepted=accepted))
    assert "or more are accepted, but for 3 doubtful images." in text
    assert "it is accepted, unless the image is doubtful" in text


def test_the_map_says_what_is_known_of_the_images() -> None:
    data = example()
    assert "Each image stands at the place that it was matched with." in page(data)
    assert data.map is not None
    told = dataclasses.replace(data.map, figures="metres of error: median 2")
    assert "to its match. Metres of error: median 2." in page(dataclasses.replace(data, map=told))


ACTIONS = """
const seen = () => [...document.querySelectorAll("#pair-grid .match")].map((card) => +card.id.slice(5));
const found = { first: seen().length };
const change = (element) => element.dispatchEvent(new Event("change"));
document.querySelector("#pair-more").click();
found.all = seen().length;
found.none = document.querySelector("#pair-3 .sheet.empty") !== null;
found.verdicts = [...document.querySelectorAll("#pair-3 h3, #pair-69 h3")].map((head) => head.textContent);
document.querySelector("[value=open]").click();
found.open = document.querySelector("#pair-count").textContent;
document.querySelector("#pair-order").value = "least";
change(document.querySelector("#pair-order"));
found.least = seen().slice(0, 3);
const route = document.querySelector(".route"), box = route.getBoundingClientRect();
route.dispatchEvent(new MouseEvent("click", { clientX: box.left + box.width * (69.5 / 70) }));
found.clicked = document.querySelector("#pair-69") !== null;
found.wide = document.documentElement.scrollWidth <= window.innerWidth;
document.body.textContent = "FOUND" + JSON.stringify(found);
"""


def test_its_switches_work(tmp_path: Path) -> None:
    file = tmp_path / "query.html"
    file.write_text(page(example()), encoding="utf-8")
    seen = visit(file)
    assert seen.console == ()
    assert 'data-ready="yes"' in seen.dom
    assert acted(page(example()), ACTIONS, tmp_path) == {
        "first": 60,
        "all": 70,
        "none": True,
        "verdicts": ["no match", "acceptedprobability 99.0 %"],
        "open": "35 of 35 shown",
        "least": [UNSURE, 0, 1],
        "clicked": True,
        "wide": True,
    }


def test_on_a_phone_nothing_sticks_out_and_words_can_be_read(tmp_path: Path) -> None:
    seen = on_phone(page(example()), tmp_path)
    assert seen.wide <= PHONE
    assert (seen.smallest or 0) >= 7


def test_names_cannot_break_the_page() -> None:
    nasty = '</script><script>alert("1")</script>&\'$x_2$\udcff'
    text = page(example(command=nasty, query_names=(nasty,) * 70, place_names=(nasty,) * 40, summary={nasty: nasty}))
    assert len(re.findall("<script", text)) == 2
    text.encode("utf-8")
