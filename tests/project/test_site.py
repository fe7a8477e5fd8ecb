"""The documentation site: every page in its menu, every command and public name on a page, links as hooks make them."""

from __future__ import annotations

import importlib
import re
import sys
import types
from pathlib import Path
from types import ModuleType

import click
import pytest

import lava_vpr
from lava_vpr.cli import main

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
MENU = re.findall(r"^ +- [^:\n]+: (\S+\.(?:md|ipynb))$", SETTINGS, re.MULTILINE)
API = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")


@pytest.fixture
def hooks(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """scripts/site_hooks.py, without mkdocs."""
    files = types.ModuleType("mkdocs.structure.files")
    files.File = files.Files = object  # type: ignore[attr-defined]
    for name in ("mkdocs", "mkdocs.structure"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, "mkdocs.structure.files", files)
    return importlib.import_module("scripts.site_hooks")


def test_every_page_stands_in_the_menu(hooks: ModuleType) -> None:
    docs = ROOT / "docs"
    pages = {str(path.relative_to(docs)) for end in ("md", "ipynb") for path in docs.rglob(f"*.{end}")}
    assert set(MENU) == pages | set(hooks.TAKEN)
    assert len(MENU) == len(set(MENU))


def test_every_public_name_is_documented() -> None:
    documented = re.findall(r"^::: ([\w.]+)$", API, re.MULTILINE)
    assert {name.rpartition(".")[2] for name in documented} >= set(lava_vpr.__all__) - {"__version__"}
    assert "`lava_vpr.__version__`" in API
    for dotted in documented:
        module, _, name = dotted.rpartition(".")
        found = getattr(importlib.import_module(module), name)
        assert found.__doc__, dotted
        assert found.__module__ == module, f"{dotted} is defined in {found.__module__}"


def test_every_command_is_documented() -> None:
    text = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    context = click.Context(main)
    for name in main.list_commands(context):
        assert f"\n## {name}\n" in text


@pytest.mark.parametrize(
    ("source", "text", "made"),
    [
        ("docs/a.md", "[x](b.md#c)", "[x](b.md#c)"),
        ("docs/a.md", "[README](../README.md)", "[README](index.md)"),
        ("docs/a.md", "[log](../benchmarks/presets.log)", "log (`benchmarks/presets.log`)"),
        ("docs/a.md", "[e](../examples/README.md#x)", "[e](examples.md#x)"),
        ("docs/a.md", "[w](https://a.b/c.md)", "[w](https://a.b/c.md)"),
        ("docs/notebooks/n.ipynb", "[l](../lava.md)", "[l](../lava.md)"),
        ("CONTRIBUTING.md", "[a](docs/architecture.md)", "[a](architecture.md)"),
        (
            "examples/README.md",
            "[r](../docs/robot.md#time) and [f](replay_bag.py)",
            "[r](robot.md#time) and f (`examples/replay_bag.py`)",
        ),
        ("docs/a.md", "![p](p.png)", "![p](p.png)"),
    ],
)
def test_links_are_those_of_the_site(hooks: ModuleType, source: str, text: str, made: str) -> None:
    assert hooks.resolved(text, source) == made


def test_a_notebooks_links_lead_to_pages(hooks: ModuleType) -> None:
    page = types.SimpleNamespace(file=types.SimpleNamespace(src_uri="notebooks/n.ipynb"))
    html = '<a href="../lava.md#x">a</a> <a href="deploy.ipynb">b</a> <a href="https://x.y/z.md">c</a>'
    assert hooks.on_post_page(html, page, None) == (
        '<a href="../lava.html#x">a</a> <a href="deploy.html">b</a> <a href="https://x.y/z.md">c</a>'
    )
    page.file.src_uri = "lava.md"
    assert hooks.on_post_page(html, page, None) == html
