"""The live page: a small HTTP server on the loopback address, which answers this machine's browsers only."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.model import Model
from lava_vpr.show.page import document
from lava_vpr.show.templates import render, safe, text
from lava_vpr.watch.watching import HISTORY, Recent

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
