"""The host programs as they stand in a bundle, in one folder, and loaded from there into this process.

Used by deploy and support.
"""

from __future__ import annotations

import ast
import importlib
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

from lava_vpr.deploy.bundle import programs


def files(board: str) -> dict[str, bytes]:
    """What ``program/`` of a bundle holds, by name."""
    return {Path(name).name: data for name, data in programs.program_files(board).items()}


def flat(board: str, folder: Path) -> Path:
    """They in a folder."""
    folder.mkdir()
    for name, content in files(board).items():
        (folder / name).write_bytes(content)
    return folder


def load(folder: Path) -> Any:
    """The modules in ``folder`` by name, as attributes. This process then knows none of them: another folder's can be
    loaded as well."""
    names = sorted(path.stem for path in folder.glob("*.py"))
    before, written = {name: sys.modules.pop(name, None) for name in names}, sys.dont_write_bytecode
    sys.path.insert(0, str(folder))
    try:
        importlib.invalidate_caches()
        return SimpleNamespace(**{name: importlib.import_module(name) for name in names})
    finally:
        sys.path.remove(str(folder))
        sys.dont_write_bytecode = written
        for name, module in before.items():
            sys.modules.pop(name, None)
            if module is not None:
                sys.modules[name] = module


def set_everywhere(modules: Any, **values: Any) -> None:
    """Set a name in every module that has it, wherever it came from."""
    for name, value in values.items():
        known = [module for module in vars(modules).values() if isinstance(module, ModuleType)]
        owners = [module for module in known if hasattr(module, name)]
        assert owners, name
        for module in owners:
            setattr(module, name, value)


def imported(board: str, version: tuple[int, int]) -> set[str]:
    """Names of the packages that a program imports, beside its own modules; it has the syntax of a Python version."""
    content = files(board)
    names = set()
    for name, text in content.items():
        if not name.endswith(".py"):
            continue
        for node in ast.walk(ast.parse(text.decode(), name, feature_version=version)):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add(str(node.module).split(".")[0])
    return names - {name.removesuffix(".py") for name in content}
