"""The evaluation report: equal bytes, nothing from outside, and a page that works in a real browser."""

from __future__ import annotations

import dataclasses
import errno
import math
import os
import re
from html.parser import HTMLParser
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest
from support.common.browser import acted, visit
from support.common.reports import BEND, REJECTED, WORDS, WRONG, example

from lava_vpr.errors import InputError
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.report.data import MapData
from lava_vpr.report.html import page
from lava_vpr.report.sections import true_place, true_role
from lava_vpr.show.page import write_page
from lava_vpr.show.svg import THEME


@pytest.fixture(scope="module")
def text() -> str:
    return page(example())


class Outline(HTMLParser):
    """Elements of a page as (tag, attributes), in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))


# The file


def test_equal_data_give_equal_bytes_whatever_the_users_style() -> None:
    first = page(example())
    with matplotlib.rc_context({"lines.linewidth": 9, "font.size": 30, "svg.fonttype": "path", "axes.grid": True}):
        before = dict(matplotlib.rcParams)
        second = page(example())
        assert dict(matplotlib.rcParams) == before
    assert first == second
    assert page(example(title="another", **WORDS)) != first


def test_a_report_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match=r"file/report.html: the report cannot be written \(File exists\); give a"):
        write_page("new", tmp_path / "file" / "report.html")
    (tmp_path / "report.html").write_text("old")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"\(No space left on device\)") as caught:
        write_page("new", tmp_path / "report.html")
    assert "\n" not in str(caught.value)
    assert (tmp_path / "report.html").read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "report.html"]


def test_large_maps_stay_below_eight_megabytes() -> None:
    n = 1000
    rng = np.random.default_rng(1)
    scores = rng.normal(size=(n, n))
    images = rng.integers(0, 256, (60, 34, 3), dtype=np.uint8)
    views = np.broadcast_to(cv2.resize(images, (160, 90)), (n, 90, 160, 3))
    data = example(
        12,
        truth=np.eye(n, dtype=np.bool_),
        matrices={"contrast": scores, "sad": scores, "cosine": scores},
        matches=scores.argmax(axis=1),
        confidence=scores.max(axis=1),
        place_names=tuple(f"images-{i:05}.png" for i in range(n)),
        query_names=tuple(f"images-{i:05}.png" for i in range(n)),
        place_numbers=tuple(range(n)),
        query_numbers=tuple(range(n)),
        place_thumbnails=views,
        query_thumbnails=views,
        weights=None,
    )
    size = len(page(data).encode())
    assert 1_000_000 < size < 8_000_000


# What is in it


def test_nothing_comes_from_outside_and_everything_is_described(text: str) -> None:
    elements = Outline(text).elements
    assert not re.search(r"https?:|@import|xmlns", text)
    for tag, attributes in elements:
        for name in ("src", "href", "xlink:href"):
            target = attributes.get(name)
            assert target is None or target.startswith(("data:", "#")), (tag, target)
        if tag == "img":
            assert attributes.get("alt")
        if tag == "svg":
            assert attributes.get("aria-label") or attributes.get("aria-hidden") == "true"
    ids = [a["id"] for _, a in elements if "id" in a]
    assert len(ids) == len(set(ids))
    targets = {a["href"] for tag, a in elements if tag == "a"}
    assert targets == {f"#{a['id']}" for tag, a in elements if tag == "section"}
    assert not [name for name, colour in THEME.items() if colour in text]
    assert "<metadata" not in text
    assert "var(--c0)" in text


def test_of_several_true_places_the_nearest_is_shown_and_counted() -> None:
    truth = np.eye(12, dtype=np.bool_)
    truth[WRONG, WRONG - 1 : WRONG + 2] = truth[REJECTED, REJECTED - 1 : REJECTED + 2] = True
    data = example(truth=truth)
    assert [true_place(data, query) for query in (0, WRONG, REJECTED)] == [0, WRONG - 1, REJECTED]
    roles = ["True place", "True place, the nearest of 3", "True place, the middle one of 3"]
    assert [true_role(data, query) for query in (0, WRONG, REJECTED)] == roles
    text = page(data)
    assert "✗ wrong by 2 places" in text
    assert f"<figcaption>{roles[1]}<br>{WRONG - 1} · r{WRONG - 1:03}.png</figcaption>" in text


def test_figures_and_sentences(text: str) -> None:
    assert 'Recognised <b class="num">10 of 12</b> places' in text
    assert "R@1 0.83 with the <em>contrast</em>" in text
    row = re.search(r"<tr class=default>.*?</tr>", text, re.DOTALL)
    assert row
    assert re.findall(r">([0-9.–]+)</td>", row[0])[:3] == ["0.833", "0.917", "0.917"]
    assert text.count('<span class="tag">baseline</span>') == 2
    assert text.count('<span class="tag">decoder</span>') == 1
    assert "✗ wrong by 3 places" in text
    assert "88,012" in text
    assert "41.2<" in text
    assert "10 of 12 best matches right" in text
    assert "605 input spikes, 60 output spikes" in text
    assert "steps = 350" in text


def test_the_most_confident_mistake_comes_first() -> None:
    n = 12
    matches = np.roll(np.arange(n), 1)
    matches[3] = 3
    text = page(example(n, matches=matches, confidence=np.arange(n) / 10.0, **WORDS))
    gallery = text[text.index('id="matches"') : text.index("Right matches")]
    shown = [float(c) for c in re.findall(r"confidence ([0-9.]+)</span>", gallery)]
    assert shown == [c / 10 for c in range(11, -1, -1) if c != 3]


def test_names_cannot_break_the_page() -> None:
    nasty = '</script><script>alert("1")</script>&\'$x_2$\udcff'
    names = tuple(f"{nasty}{i}" for i in range(12))
    data = example(title=nasty, command=nasty, summary={nasty: nasty}, place_names=names, query_names=names)
    text = page(dataclasses.replace(data, matrices={}, rasters=data.rasters[:1]))
    assert [a for tag, a in Outline(text).elements if tag == "script"] == [
        {"type": "application/json", "id": "report-data"},
        {},
    ]
    text.encode("utf-8")


@pytest.mark.parametrize("kind", ["onoff", "pixels"])
def test_other_inputs_are_drawn_as_images(kind: str) -> None:
    text = page(example(kind=kind, **WORDS))
    assert text.count('alt="Weights of neuron') == 12
    assert 'class="strokes"' not in text
    assert 'id="overlay"' not in text


def test_degenerate_reports() -> None:
    nothing = Metrics(math.nan, {}, math.nan, math.nan, math.nan, 0, 0, np.zeros(0), np.zeros(0), np.zeros(0))
    data = example(1, metrics={"contrast": nothing}, rasters=(), weights=None, matrices={}, events={})
    text = page(dataclasses.replace(data, matches=np.array([-1]), truth=np.zeros((1, 1), np.bool_)))
    assert 'Recognised <b class="num">0 of 1</b> places' in text
    assert text.count(">–</td>") == 6
    for absent in ("scores", "fields", "spikes", "cost"):
        assert f'id="{absent}"' not in text
        assert f'href="#{absent}"' not in text
    assert "Every query was matched to a true place." in page(example(1, confidence=np.array([math.inf]), rasters=()))
    flat = np.zeros((12, 12))
    matrices = {"contrast": flat, "sad": np.full((12, 12), np.nan)}
    assert "0 of 12 best matches right" in page(example(matrices=matrices, matches=np.full(12, -1), rasters=()))


def test_arrays_that_do_not_belong_together_are_refused() -> None:
    for name, value, said in (
        ("truth", np.eye(3, dtype=np.bool_), r"ReportData\.\w+ must"),
        ("matches", np.full(12, 12), r"ReportData\.\w+ must"),
        ("weights", np.zeros((3, 12)), r"ReportData\.\w+ must"),
        ("query_numbers", (0, 1), r"ReportData\.\w+ must"),
        ("query_thumbnails", np.zeros((12, 4, 4), np.uint8), r"ReportData\.\w+ must"),
        ("default_decoder", "none", r"ReportData\.\w+ must"),
        ("map", MapData(BEND, BEND[1:], ""), r"map\.queries must be finite, of shape \(12, 2\)"),
        ("map", MapData(np.full((12, 2), np.nan), BEND, ""), r"map\.places must be finite"),
    ):
        with pytest.raises(ValueError, match=said):
            example(**{name: value})


# In a browser


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_page(page(example()), tmp_path_factory.mktemp("report") / "deep" / "report.html")


@pytest.mark.quick(1)
def test_the_page_runs_in_a_browser_without_a_word(report: Path) -> None:
    result = visit(report)
    assert result.console == ()
    assert 'data-ready="yes"' in result.dom
    body = result.dom[result.dom.index("<tbody") : result.dom.index("</tbody>")]
    assert body.count("<tr") == 4
    sections = "figures curves route scores fields spikes matches cost setup".split()
    assert [a["id"] for tag, a in Outline(result.dom).elements if tag == "section"] == sections
    # The script shows the most confident mistake first.
    assert ">wrong, confidence " in result.dom
    assert f"Query {WRONG} · q005.png" in result.dom


ACTIONS = """
document.querySelectorAll("table.sortable th button")[1].click();
document.querySelector(".legend li[data-curve='1'] input").click();
document.querySelector("[data-scale=query]").click();
document.querySelector("[data-toggle*=truth]").click();
document.querySelector("#overlay").click();
for (let i = 0; i < 4; i++) document.querySelector("#browse-on").click();
const found = {
  order: [...document.querySelectorAll("table.sortable tbody tr")].map((r) => +r.children[1].dataset.value),
  sort: document.querySelector("th[aria-sort]").getAttribute("aria-sort"),
  curve: getComputedStyle(document.querySelector("#pr-1")).display,
  other: getComputedStyle(document.querySelector("#pr-0")).display,
  whole: getComputedStyle(document.querySelector("#m0-whole")).display,
  query: getComputedStyle(document.querySelector("#m0-query")).display,
  truth: getComputedStyle(document.querySelector("#m2-truth")).display,
  overlay: document.querySelector("#field-grid").classList.contains("overlay"),
  verdict: document.querySelector("#browse-verdict").textContent,
  name: document.querySelector("#browse-query-name").textContent,
  wide: document.documentElement.scrollWidth <= window.innerWidth,
};
document.body.textContent = "FOUND" + JSON.stringify(found);
"""


def test_figures_with_gains_stand_below_those_without() -> None:
    metrics = example().metrics
    changed = {("sad", "adapted"): metrics["cosine"], ("contrast", "gains"): metrics["sad"]}
    table = page(example(changed=changed)).partition('<section id="figures">')[2].partition("</section>")[0]
    rows = dict(re.findall(r'<th scope="row" data-value="([^"]*)".*?<td data-value="([^"]*)"', table))
    assert list(rows) == ["contrast", "contrast, gains", "SAD", "SAD, adapted", "cosine of the inputs", "weighted"]
    assert rows["contrast, gains"] == rows["SAD"] != rows["contrast"]
    assert "Gains: inputs count as much" in table
    assert "Adapted: what stays" in table
    assert "Gains:" not in page(example(changed={("sad", "adapted"): metrics["sad"]}))


def test_its_switches_work(report: Path, tmp_path: Path) -> None:
    state = acted(report.read_text(encoding="utf-8"), ACTIONS, tmp_path)
    assert state.pop("order") == sorted((m.recall_at_1 for m in example().metrics.values()), reverse=True)
    assert state == {
        "sort": "descending",
        "curve": "none",
        "other": "inline",
        "whole": "none",
        "query": "inline",
        "truth": "none",
        "overlay": True,
        "verdict": "no match",
        "name": f"Query {REJECTED} · q009.png",
        "wide": True,
    }


def test_foreign_scripts_are_refused_and_errors_are_seen(report: Path, tmp_path: Path) -> None:
    text = report.read_text(encoding="utf-8")
    foreign = tmp_path / "foreign.html"
    foreign.write_text(text.replace("</body>", "<script>document.title = 'taken'</script></body>"), encoding="utf-8")
    result = visit(foreign)
    assert "Content Security Policy" in "".join(result.console)
    assert "<title>taken" not in result.dom
    broken = tmp_path / "broken.html"
    broken.write_text("<!DOCTYPE html><title>x</title><script>null.x</script>", encoding="utf-8")
    assert "TypeError" in "".join(visit(broken).console)
