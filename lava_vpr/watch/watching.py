"""Image after image of a source to a `Localizer`, what is said of each as a line of JSON, and the live page.

A small HTTP server on the loopback address serves the page, to this machine's browsers only. Its text and pictures are
made when somebody looks.
"""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.inputs.encoder import THUMBNAIL
from lava_vpr.inputs.vectors import picture_of
from lava_vpr.localizer import Localizer
from lava_vpr.matches import Match, Unfollowed
from lava_vpr.model import Model
from lava_vpr.readers import Frame
from lava_vpr.report.images import data_uri, shrunk
from lava_vpr.show.page import document
from lava_vpr.show.templates import render, safe, text


@dataclass(frozen=True)
class Watched:
    """An image and what is said of it.

    Attributes:
        index: Its number in the source, from 0; unreadable ones have one, too.
        seen: The image.
        match: Where it was taken.
    """

    index: int
    seen: Frame
    match: Match

    def values(self) -> dict[str, Any]:
        """The keys and values of its line."""
        return {"query": self.index, "query_name": self.seen.name, **self.match.values()}


def watch(
    localizer: Localizer, source: Iterable[Frame], refused: Callable[[int, InputError], None]
) -> Iterator[Watched]:
    """Take the images of ``source`` as they come.

    Args:
        localizer: Asked where each was taken.
        source: The images.
        refused: Called with the number of each that cannot be read or answered, and why; watching goes on.
    Raises:
        LavaVprError: the source goes away.
    """
    for index, seen in enumerate(source):
        if isinstance(seen.image, InputError):
            refused(index, seen.image)
            continue
        try:
            match = localizer.update(seen.image, seen.stamp, name=seen.name)
        except InputError as error:
            refused(index, error)
            continue
        yield Watched(index, seen, match)


HISTORY = 120
"""Number of answers that the page shows."""
_ROWS = 360
"""Rows of the spike raster, at most: of more neurons the most spikes of each few are shown."""
_COLOUR = (201, 143, 43)  # BGR, to be told from white and from black
_QUERY_SIDE = 480
_NOTHING = "data:,"


class Recent:
    """The last answers; one thread adds them, others look.

    Args:
        model: The model that answers.
    Attributes:
        said: The status, and how many images were answered, recognised and refused.
        unfollowed: Counts what the filter did not follow.
    """

    def __init__(self, model: Model) -> None:
        self._thumbnails = model.thumbnails
        self._numbers = {int(index): number for number, index in enumerate(model.place_indices)}
        of_place = model.neuron_places()
        self._neurons = np.argsort(np.where(of_place < 0, model.places, of_place), kind="stable")
        self._together = -(-model.neurons // _ROWS)
        self._lock = threading.Lock()
        self._history: deque[dict[str, Any]] = deque(maxlen=HISTORY)
        self._spikes: deque[NDArray[np.uint16]] = deque(maxlen=HISTORY)
        self._last: Watched | None = None
        self.said: dict[str, Any] = {"status": "waiting", "answered": 0, "recognised": 0, "refused": 0}
        self.unfollowed = Unfollowed()
        self._version, self._made = 0, (-1, b"")

    def add(self, watched: Watched) -> None:
        """Take the next answer."""
        match = watched.match
        counts = np.minimum(match.spikes[self._neurons], 65535).astype(np.uint16)
        pooled = np.maximum.reduceat(counts, np.arange(0, len(counts), self._together))
        values = watched.values()
        entry = {"at": self._number(match.place), **{key: values[key] for key in ("probability", "accepted")}}
        with self._lock:
            self._last = watched
            self._history.append(entry)
            self._spikes.append(pooled)
            self.said["answered"] += 1
            self.said["recognised"] += int(match.accepted)
            self.unfollowed.add(match)
            self._say(status="watching")

    def refuse(self) -> None:
        """Take note of an image that cannot be read."""
        with self._lock:
            self._say(refused=self.said["refused"] + 1)

    def end(self) -> None:
        """Take note that no further image comes."""
        with self._lock:
            self._say(status="the source has ended")

    def state(self, seen: int) -> bytes:
        """All that the page shows, as JSON; only its version, if that is the one which was ``seen``."""
        with self._lock:
            version, last, said = self._version, self._last, dict(self.said)
            history, spikes = list(self._history), list(self._spikes)
            if seen == version:
                return json.dumps({"version": version}).encode()
            if self._made[0] == version:
                return self._made[1]
        made = json.dumps({"version": version, **said, **self._drawn(last, history, spikes)}).encode()
        with self._lock:
            self._made = (version, made)
        return made

    def _say(self, **changed: Any) -> None:
        self.said.update(changed)
        self._version += 1

    def _number(self, place: int) -> int:
        """The number of the place with this absolute index among the model's; -1: none."""
        return self._numbers.get(place, -1)

    def _drawn(
        self, last: Watched | None, history: list[dict[str, Any]], spikes: list[NDArray[np.uint16]]
    ) -> dict[str, Any]:
        """The last answer and its pictures."""
        if last is None or isinstance(last.seen.image, Exception):
            return {}
        values = last.values()
        at = self._number(last.match.place)
        return {
            **values,
            "at": at,
            "where": ", ".join(f"{name} {values[name]}" for name in ("x", "y", "lat", "lon") if name in values),
            "candidates": [found | {"at": self._number(found["place"])} for found in values["candidates"]],
            "query_image": data_uri(_pictured(last.seen.image)),
            "match_image": data_uri(self._thumbnails[at]) if at >= 0 else _NOTHING,
            "raster": data_uri(raster(spikes), lossless=True),
            "history": history,
        }


def _pictured(seen: NDArray[Any]) -> NDArray[np.uint8]:
    """An image, or a vector, as the page shows it."""
    return picture_of(seen, THUMBNAIL) if seen.ndim == 1 else shrunk(seen, _QUERY_SIDE)


def raster(spikes: list[NDArray[np.uint16]]) -> NDArray[np.uint8]:
    """Spike counts as a picture, uint8 (rows, `HISTORY`, 4) BGRA: a column a query, the last one on the right; the more
    spikes, the less one sees through.

    Args:
        spikes: The counts of each query, oldest first, uint16 (rows,), at least one and at most `HISTORY`.
    """
    counts = np.zeros((len(spikes[0]), HISTORY), np.float64)
    counts[:, HISTORY - len(spikes) :] = np.stack(spikes, axis=1)
    picture = np.empty((*counts.shape, 4), np.uint8)
    picture[:, :, :3] = _COLOUR
    picture[:, :, 3] = np.round(255 * np.sqrt(counts / max(1.0, counts.max())))
    return np.asarray(cv2.resize(picture, None, fx=2, fy=1, interpolation=cv2.INTER_NEAREST), np.uint8)


LOOPBACK = "127.0.0.1"
PORT = 8765
_WIDTH, _LEAST, _MOST, _MARGIN = 600, 90, 420, 20
_IDLE_S = 30  # a connection that asks for nothing is closed
_HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
}


@contextmanager
def live_page(model: Model, source: str, recent: Recent, port: int = PORT) -> Iterator[str]:
    """Serve the page until the end of the block, from a thread of its own and one for each open connection.

    Args:
        model: The model that answers.
        source: What is watched, for the title.
        recent: What the page shows.
        port: A port of `LOOPBACK`; 0: any that is free.
    Yields:
        Its address.
    Raises:
        InputError: the port is taken or closed to us.
    """
    try:
        server = _Server((LOOPBACK, port), _Handler)
    except OSError as error:
        raise InputError(
            f"--page: {LOOPBACK}:{port} cannot be served ({error.strerror}); name another port, 0 for any that is free"
        ) from None
    server.recent, server.page = recent, page(model, source).encode()
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield f"http://{LOOPBACK}:{server.server_address[1]}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


class _Server(ThreadingHTTPServer):
    """The server, with what its handlers answer."""

    daemon_threads = True
    block_on_close = False
    recent: Recent
    page: bytes

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Nothing: a browser that goes away is none of ours."""


class _Handler(BaseHTTPRequestHandler):
    """Answers one connection: the page, and its state."""

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "lava-vpr", ""
    timeout = _IDLE_S
    server: _Server

    def do_GET(self) -> None:
        """Answer a request."""
        url = urlsplit(self.path)
        if not self._is_ours():
            self._answer(403, "text/plain; charset=utf-8", b"this page is for its own address only\n")
        elif url.path == "/":
            self._answer(200, "text/html; charset=utf-8", self.server.page)
        elif url.path == "/state":
            self._answer(200, "application/json", self.server.recent.state(_number(parse_qs(url.query).get("seen"))))
        else:
            self._answer(404, "text/plain; charset=utf-8", b"there is nothing here; the page is at /\n")

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: standard error is for people."""

    def _is_ours(self) -> bool:
        """Whether the browser means this server: under another name, a foreign page might be asking through it."""
        port = self.server.server_address[1]
        return self.headers.get("Host") in (f"{LOOPBACK}:{port}", f"localhost:{port}")

    def _answer(self, code: int, kind: str, content: bytes) -> None:
        self.send_response(code)
        for name, value in {"Content-Type": kind, "Content-Length": str(len(content)), **_HEADERS}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)


def _number(words: list[str] | None) -> int:
    """The version that the page has seen; -1: none."""
    word = words[0] if words else ""
    return int(word) if word.isascii() and word.isdigit() and len(word) <= 18 else -1


def page(model: Model, source: str) -> str:
    """The page as HTML text; all that changes is asked for by its script."""
    points, height = _points(model)
    known = model.whereabouts is not None
    drawn = " ".join(f"{x:g},{y:g}" for x, y in points)
    dots = "".join(f'<circle class="place" r="2.5" cx="{x:g}" cy="{y:g}"/>' for x, y in points)
    body = render(
        "watch_body.html",
        title=safe(f"lava-vpr watch: {source}"),
        places=str(model.places),
        neurons=str(model.neurons),
        map_title="Map" if known else "Route",
        map_note="The places where they were learned." if known else "The places in their order, first to last.",
        width=str(_WIDTH),
        height=f"{height:g}",
        route=f'<polyline points="{drawn}"/>{dots if model.places <= 400 else ""}',
        history=str(HISTORY),
    )
    payload = json.dumps({"points": points, "history": HISTORY}, separators=(",", ":"))
    return document(
        f"lava-vpr watch: {source}",
        body,
        style=f"\n{text('watch.css')}\n",
        payload=payload,
        script=f"\n{text('watch.js')}\n",
        asks=True,
        footer="This page asks nobody but the lava-vpr that serves it on this computer.",
    )


def _points(model: Model) -> tuple[list[list[float]], float]:
    """Where each place stands in the drawing, x to the right and y down, and the height of the drawing."""
    where = model.whereabouts
    if where is None:
        across = np.linspace(_MARGIN, _WIDTH - _MARGIN, model.places)
        return [[round(float(x), 1), _LEAST / 2] for x in across], _LEAST
    plane = where.plane() * (1.0, -1.0)
    low, span = plane.min(axis=0), np.ptp(plane, axis=0)
    room = np.array([_WIDTH, _MOST]) - 2 * _MARGIN
    scale = float((room / np.maximum(span, 1e-9)).min())
    height = max(_LEAST, span[1] * scale + 2 * _MARGIN)
    middle: NDArray[np.float64] = np.array([_WIDTH, height]) / 2
    placed = (plane - low - span / 2) * scale + middle
    return np.round(placed, 1).tolist(), round(float(height), 1)
