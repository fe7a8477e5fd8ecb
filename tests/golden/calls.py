"""Python of a case: what its last expression gives, or the error, as text that a person can compare.

The names that it finds are those of `lava_vpr`, numpy as ``np``, ``Path``, and the two functions here.
"""

from __future__ import annotations

import ast
import dataclasses
import hashlib
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

PLAIN = 12  # values of an array that are shown


def images(folder: str) -> list[Any]:
    """The images of a folder, in order, uint8 (h, w, 3)."""
    return [cv2.imread(str(path)) for path in sorted(Path(folder).iterdir())]


def shown(value: Any, indent: str = "") -> str:
    """A value, field by field; of a long array its type, shape and digest."""
    inner = indent + "  "
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [f"{inner}{one.name}: {shown(getattr(value, one.name), inner)}" for one in dataclasses.fields(value)]
        return "\n".join([type(value).__name__, *fields])
    if isinstance(value, np.ndarray) and value.size > PLAIN:
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"{value.dtype} {value.shape} {digest}"
    if isinstance(value, (list, tuple)) and any(map(dataclasses.is_dataclass, value)):
        return "".join(f"\n{inner}{shown(one, inner)}" for one in value)
    return f"{value.dtype} {value.tolist()}" if isinstance(value, np.ndarray) else repr(value)


def run(code: str) -> int:
    """Run a case's code, print what its last expression gives, and return the exit code; 1 after an error."""
    import lava_vpr

    names = {name: getattr(lava_vpr, name) for name in lava_vpr.__all__}
    names |= {"np": np, "Path": Path, "images": images, "shown": shown}
    parts = ast.parse(code).body
    last = parts.pop() if isinstance(parts[-1], ast.Expr) else None
    try:
        exec(compile(ast.Module(parts, []), "case", "exec"), names)
        if last is not None:
            print(shown(eval(compile(ast.Expression(last.value), "case", "eval"), names)))
    except Exception as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    return 0
