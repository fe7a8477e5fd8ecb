"""A real browser for tests of pages: load a file in headless Chromium, get its DOM and what its console said.

Used by bench, report, studies and watch.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import pytest

_CANDIDATES = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--v=0",
    "--virtual-time-budget=3000",
)
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
        done = subprocess.run(command, capture_output=True, timeout=timeout, check=False)
    log = done.stderr.decode("utf-8", "replace")
    if done.returncode != 0:
        pytest.fail(f"{browser} exited with {done.returncode}: {log[-2000:]}")
    console = tuple(match["text"] for match in _CONSOLE.finditer(log))
    return Visit(done.stdout.decode("utf-8", "replace"), console)
