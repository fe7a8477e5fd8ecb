"""A real browser for tests of pages: load a file in headless Chromium, get its DOM and what its console said.

Used by bench, report, studies and watch.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from support.common import children

_CANDIDATES = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --disable-dev-shm-usage --no-first-run --hide-scrollbars "
    "--disable-background-networking --disable-component-update --disable-sync --enable-logging=stderr --v=0 "
    "--virtual-time-budget=3000"
).split()
# [123:123:1121/142200.123456:INFO:CONSOLE:12] "text", source: file:///page.html (12); older ones CONSOLE(12).
_CONSOLE = re.compile(r':CONSOLE[:(]\d+\)?\] "(?P<text>.*?)", source: [^\n]*$', re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Visit:
    """What became of a page: its DOM after the scripts ran, and its console messages.

    Chromium logs messages of every severity, uncaught errors and blocked resources as INFO: a page that is in order
    says nothing at all.
    """

    dom: str
    console: tuple[str, ...]


def find() -> str:
    """The browser's path, or skip the test."""
    for name in filter(None, (os.environ.get("CHROMIUM"), *_CANDIDATES)):
        path = shutil.which(name)
        if path:
            return path
    pytest.skip("needs a browser: install chromium, or set CHROMIUM to one")


def visit(page: Path | str, *, size: str = "1200,1600", screenshot: Path | None = None, timeout: float = 60) -> Visit:
    """Load ``page`` with a fresh profile and let its scripts run.

    Args:
        page: An HTML file, or the address of a page.
        size: Width and height of the window, in CSS pixels.
        screenshot: Where to write a PNG of the window, if wanted; the DOM is empty then.
        timeout: Seconds after which the test fails.
    """
    browser, address = find(), page if isinstance(page, str) else page.as_uri()
    task = f"--screenshot={screenshot}" if screenshot else "--dump-dom"
    with tempfile.TemporaryDirectory(prefix="browser-", ignore_cleanup_errors=True) as profile:
        command = [browser, *_OPTIONS, f"--window-size={size}", f"--user-data-dir={profile}", task, address]
        done = children.run(command, capture_output=True, timeout=timeout, check=False)
    log = done.stderr.decode("utf-8", "replace")
    if done.returncode != 0:
        pytest.fail(f"{browser} exited with {done.returncode}: {log[-2000:]}")
    console = tuple(match["text"] for match in _CONSOLE.finditer(log))
    return Visit(done.stdout.decode("utf-8", "replace"), console)


_POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')


def acted(text: str, actions: str, folder: Path) -> dict[str, Any]:
    """What a script finds that acts on a copy of a page: the page's policy, by hash, allows its own script only."""
    (folder / "acted.html").write_text(_POLICY.sub("", text).replace("</body>", f"<script>{actions}</script></body>"))
    result = visit(folder / "acted.html", size="500,900")
    assert result.console == ()
    found = re.search(r"FOUND(\{.*\})", result.dom)
    assert found, result.dom[-500:]
    return dict(json.loads(found[1]))


PHONE = 400
"""Width of a phone's screen, in CSS pixels."""
_MEASURE = """setTimeout(() => {
  const words = [...document.querySelectorAll("svg text")].filter((word) => word.textContent.trim());
  const scale = (word) => Math.hypot(word.getScreenCTM().c, word.getScreenCTM().d);
  const sizes = words.map((word) => parseFloat(getComputedStyle(word).fontSize) * scale(word));
  const least = sizes.length ? Math.min(...sizes) : null;
  const said = document.querySelector(SAYS);
  parent.postMessage([document.documentElement.scrollWidth, innerWidth, least, said && said.textContent], "*");
}, 1500);"""


@dataclass(frozen=True)
class OnPhone:
    """How a page looks on a phone.

    Attributes:
        wide: Width of what the page needs; more than `PHONE`, and it scrolls sideways as a whole.
        smallest: Size of the smallest words in drawings, in CSS pixels; None without any.
        said: What the element that was named says.
    """

    wide: int
    smallest: float | None
    said: str | None


def on_phone(text: str, folder: Path, *, says: str = "h1", stub: str = "") -> OnPhone:
    """Open a page in a frame of `PHONE` pixels, since no window of the browser is so narrow.

    Args:
        text: The page; its policy is taken off, so that it can be measured.
        folder: Where to write files.
        says: Selector of an element.
        stub: HTML that takes the policy's place.
    """
    text = _POLICY.sub(lambda _: stub, text)
    measure = _MEASURE.replace("SAYS", json.dumps(says))
    (folder / "inner.html").write_text(text.replace("</body>", f"<script>{measure}</script></body>"), encoding="utf-8")
    told = "onmessage = (e) => { document.body.textContent = 'FOUND' + JSON.stringify(e.data); }"
    frame = f'<iframe src="inner.html" style="width:{PHONE}px;height:900px;border:0">'
    (folder / "outer.html").write_text(f"<body><script>{told}</script>{frame}")
    found = re.search(r"FOUND(\[.*?\])", visit(folder / "outer.html").dom)
    assert found is not None, "the page does not tell how wide it is"
    wide, window, smallest, said = json.loads(found[1])
    assert window == PHONE
    return OnPhone(wide, smallest, said)
