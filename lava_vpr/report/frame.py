"""The frame of every page: one HTML file that asks the network for nothing, and may not."""

from __future__ import annotations

import base64
import hashlib

from lava_vpr import __version__
from lava_vpr.report.assets import STYLE
from lava_vpr.report.text import safe


def document(title: str, body: str, *, style: str = "", payload: str = "", script: str = "") -> str:
    """A whole page as HTML text.

    Args:
        title: Of the window, as plain text.
        body: Header, navigation and main part, as HTML.
        style: What the page adds to the common style sheet.
        payload: JSON for the script, that cannot end its own element; without a script, none.
        script: The only one that the page's policy lets run; "" for none at all.
    """
    allowed, scripts = "", ""
    if script:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        allowed = f"; script-src 'sha256-{digest}'"
        scripts = f'<script type="application/json" id="report-data">{payload}</script>\n<script>{script}</script>'
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'{allowed}"
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width,initial-scale=1">
<link rel="icon" href="data:,"><title>{safe(title)}</title>
<style>{STYLE}{style}</style></head><body>
{body}
<footer>Written by lava-vpr {__version__}. One file, no network needed.</footer>
{scripts}</body></html>
"""
