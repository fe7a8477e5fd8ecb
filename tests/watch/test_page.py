"""The live page: what it answers and to whom, and what a real browser makes of it."""

from __future__ import annotations

import base64
import dataclasses
import http.client
import json
import re
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.common.browser import PHONE, on_phone, visit
from support.common.imagefiles import refused, smooth_picture

from lava_vpr import Localizer, load
from lava_vpr.errors import InputError
from lava_vpr.images.imagefiles import read_image
from lava_vpr.model import Model
from lava_vpr.readers import Frame
from lava_vpr.watch.watching import HISTORY, Recent, Watched, live_page, page, raster, watch

NASTY = "</script><b>&\"'\u2028.png"


@pytest.fixture(scope="module")
def model(made: Path) -> Model:
    """The map of the synthetic route."""
    return load(made / "m.lvpr")


@pytest.fixture(scope="module")
def answers(made: Path, model: Model) -> list[Watched]:
    """The queries of the route, answered; the last one has a name that no page should take for its own."""
    paths = sorted((made / "query").iterdir())
    source = [Frame(path.name, 7.0, read_image(path)) for path in paths]
    source[-1] = source[-1]._replace(name=NASTY)
    return list(watch(Localizer(model), source, lambda index, why: None))


@contextmanager
def served(model: Model, answers: list[Watched]) -> Iterator[tuple[int, Recent]]:
    """A page that shows ``answers``, by its port."""
    recent = Recent(model)
    for answer in answers:
        recent.add(answer)
    with live_page(model, "fra<b>mes", recent, 0) as address:
        yield int(address.removesuffix("/").rpartition(":")[2]), recent


def ask(port: int, path: str = "/", host: str | None = None, method: str = "GET") -> tuple[int, bytes, dict[str, str]]:
    """The code, content and headers of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request(method, path, headers={} if host is None else {"Host": host})
    answer = connection.getresponse()
    found = answer.status, answer.read(), dict(answer.getheaders())
    connection.close()
    return found


def state_of(port: int, seen: object = -1) -> dict[str, Any]:
    """The state as the page gets it."""
    return dict(json.loads(ask(port, f"/state?seen={seen}")[1]))


def picture(uri: str) -> np.ndarray:
    """The pixels of a data URI."""
    return cv2.imdecode(np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8), cv2.IMREAD_UNCHANGED)


def test_the_state_tells_the_last_answer(model: Model, answers: list[Watched]) -> None:
    with served(model, answers) as (port, recent):
        recent.refuse()
        state = state_of(port)
        last = answers[-1].values()
        assert {key: state[key] for key in last if key != "candidates"} == {
            key: value for key, value in last.items() if key != "candidates"
        }
        assert [state["answered"], state["refused"], state["status"]] == [8, 1, "watching"]
        assert state["recognised"] == sum(answer.match.accepted for answer in answers)
        assert [entry["at"] for entry in state["history"]] == [answer.match.place for answer in answers]
        np.testing.assert_array_equal(picture(state["match_image"]), model.thumbnails[answers[-1].match.place])
        assert picture(state["query_image"]).shape == np.asarray(answers[-1].seen.image).shape
        recent.end()
        assert state_of(port)["status"] == "the source has ended"


def test_what_was_seen_is_not_sent_again(model: Model, answers: list[Watched]) -> None:
    with served(model, answers[:2]) as (port, recent):
        first = state_of(port)
        assert state_of(port, first["version"]) == {"version": first["version"]}
        recent.add(answers[2])
        assert state_of(port, first["version"])["query"] == 2
        for word in ("", "x", "-3", "9" * 40, "%00"):
            assert state_of(port, word)["answered"] == 3


def test_before_the_first_image_there_is_nothing_to_see(model: Model) -> None:
    with served(model, []) as (port, _):
        assert state_of(port) == {"version": 0, "status": "waiting", "answered": 0, "recognised": 0, "refused": 0}


def test_the_history_is_bounded(model: Model, answers: list[Watched]) -> None:
    recent = Recent(model)
    for _ in range(HISTORY):
        for answer in answers[:2]:
            recent.add(answer)
    state = json.loads(recent.state(-1))
    assert len(state["history"]) == HISTORY
    assert state["answered"] == 2 * HISTORY


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost", "", "localhost.evil.example"]
)
@pytest.mark.parametrize("path", ["/", "/state"])
def test_other_hosts_are_refused(host: str, path: str, model: Model) -> None:
    """A page of elsewhere whose name is made to lead here would read along (DNS rebinding)."""
    with served(model, []) as (port, _):
        assert ask(port, path, host)[0] == 403
        assert ask(port, path, f"localhost:{port}")[0] == ask(port, path, f"127.0.0.1:{port}")[0] == 200


def test_nothing_else_is_answered(model: Model) -> None:
    with served(model, []) as (port, _):
        assert [ask(port, path)[0] for path in ("/x", "/../etc/passwd", "/state/")] == [404] * 3
        assert ask(port, "/", method="POST")[0] == 501
        headers = ask(port)[2]
        assert headers["Cache-Control"] == "no-store"
        assert headers["X-Frame-Options"] == "DENY"
        assert "Access-Control-Allow-Origin" not in headers


def test_it_is_on_the_loopback_address_alone(model: Model) -> None:
    with served(model, []) as (port, _), socket.socket() as other:
        other.settimeout(2)
        with pytest.raises(OSError, match="refused"):
            other.connect(("127.0.0.2", port))


def test_a_busy_port_is_one_line(model: Model) -> None:
    with served(model, []) as (port, recent):
        page_again = live_page(model, "x", recent, port)
        refused(page_again.__enter__, f"--page: 127.0.0.1:{port} cannot be served (Address already in use)", "another")
    with live_page(model, "x", recent, port):  # which is free again
        pass


def test_answers_start_no_thread_and_the_end_leaves_none(model: Model, answers: list[Watched]) -> None:
    before = threading.active_count()
    with served(model, answers) as (_, recent):
        for answer in answers * 5:
            recent.add(answer)
        assert threading.active_count() == before + 1
    assert threading.active_count() == before


def test_a_raster_has_a_column_for_each_query() -> None:
    counts = [np.array([0, 4], np.uint16), np.array([16, 0], np.uint16)]
    opaque = raster(counts)[:, ::2, 3]
    assert opaque.shape == (2, HISTORY)
    assert opaque[:, -2:].tolist() == [[0, 255], [128, 0]]
    assert not opaque[:, :-2].any()


def test_no_raster_is_higher_than_a_page(model: Model, answers: list[Watched]) -> None:
    many = dataclasses.replace(model, responses=np.repeat(model.responses, 100, axis=0))
    recent = Recent(many)
    match = dataclasses.replace(answers[0].match, spikes=np.repeat(answers[0].match.spikes, 100))
    recent.add(dataclasses.replace(answers[0], match=match))
    shape = picture(json.loads(recent.state(-1))["raster"]).shape
    assert many.neurons > 360
    assert shape[0] <= 360


def test_a_browser_shows_it(model: Model, answers: list[Watched], tmp_path: Path) -> None:
    """What a person sees, from the DOM after its script has asked; no error, and nothing taken for markup."""
    with served(model, answers) as (port, _):
        seen = visit(f"http://127.0.0.1:{port}/")
        shot = tmp_path / "page.png"
        visit(f"http://127.0.0.1:{port}/", screenshot=shot)
    assert seen.console == ()
    assert 'data-ready="yes"' in seen.dom
    assert "<b>" not in seen.dom
    assert "image 7 · &lt;/script&gt;&lt;b&gt;" in seen.dom
    match = answers[-1].match
    assert re.search(rf'id="say">[^<]*place {match.place}, \d+ %', seen.dom)
    assert len(re.findall(r'<rect x="[\d.]+" width="0.84"', seen.dom)) == len(answers)
    rows = re.search(r'<tbody id="candidates">(.*?)</tbody>', seen.dom)
    assert rows is not None
    assert [int(place) for place in re.findall(r"<tr><td>(\d+) · ", rows[1])] == [c.place for c in match.candidates]
    x = re.search(r'<circle id="here" r="11" cx="([\d.]+)"', seen.dom)
    assert x is not None
    assert float(x[1]) > 500  # the last of the places
    assert cv2.imread(str(shot)).std() > 20


def test_it_is_as_wide_as_a_phone(model: Model, answers: list[Watched], tmp_path: Path) -> None:
    """At 400 pixels nothing sticks out."""
    recent = Recent(model)
    for answer in answers:
        recent.add(answer)
    state = recent.state(-1).decode().replace("<", "\\u003c")
    stub = f"<script>window.fetch = () => Promise.resolve({{json: () => ({state})}});</script>"
    seen = on_phone(page(model, "x" * 90), tmp_path, says="#say", stub=stub)
    assert seen.wide <= PHONE
    assert seen.said is not None
    assert "place" in seen.said


@pytest.mark.parametrize(
    "places", [[[0, 0], [0, 0]], [[0, 0], [5, 0]], [[0, 0], [0, 9e5]], [[1e6, 1e6], [1e6 + 3, 1e6]]]
)
def test_a_map_of_any_shape_fits(places: list[list[float]], model: Model) -> None:
    known = np.tile(np.array(places, np.float64), (4, 1))
    text = page(dataclasses.replace(model, positions=known, frame="xy"), "x")
    data = json.loads(re.findall(r'id="report-data">(.*?)</script>', text)[0])
    points, height = np.array(data["points"]), float(re.findall(r'viewBox="0 0 600 ([\d.]+)"', text)[0])
    assert ((points >= 0) & (points <= [600, height])).all()
    assert 90 <= height <= 420


def test_a_position_in_the_north_is_drawn_above(model: Model) -> None:
    where = np.stack([np.linspace(52, 53, 8), np.full(8, 13.0)], axis=1)  # lat, lon: due north
    text = page(dataclasses.replace(model, positions=where, frame="latlon"), "x")
    points = np.array(json.loads(re.findall(r'id="report-data">(.*?)</script>', text)[0])["points"])
    assert (np.diff(points[:, 1]) < 0).all()
    assert np.ptp(points[:, 0]) == 0


def test_an_image_of_any_size_is_shown_small(model: Model) -> None:
    image = smooth_picture(1, (900, 1600))
    (answer,) = watch(Localizer(model), [Frame("big", None, image)], lambda index, why: pytest.fail(str(why)))
    recent = Recent(model)
    recent.add(answer)
    assert max(picture(json.loads(recent.state(-1))["query_image"]).shape) == 480
    assert not isinstance(answer.seen.image, InputError)
