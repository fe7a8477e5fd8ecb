"""What cases gave as a record that can be compared: short texts in full, of all else a digest.

What differs between runs and machines with good reason is taken out by `RULES`; each says why.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

RECORD = Path(__file__).parent / "record.json"
LONGEST = {"stdout": 8000, "stderr": 8000}  # characters of a text that stands in the record in full
LONGEST_FILE = 600  # those of a file's
CROWD = 5  # files of one kind in a folder that share a line


class Rule(NamedTuple):
    """Takes out of some parts of some cases what may differ.

    Attributes:
        cases: Pattern of the cases' keys.
        parts: Pattern of their parts: ``stdout``, ``stderr``, or a file's path.
        change: From what a part holds to what is compared.
        why: Why that may differ.
    """

    cases: str
    parts: str
    change: Callable[[str], str]
    why: str


def replaced(*pairs: str) -> Callable[[str], str]:
    """The change that replaces what patterns find: pattern, replacement, pattern, ..."""

    def change(text: str) -> str:
        for pattern, new in zip(pairs[::2], pairs[1::2], strict=True):
            text = re.sub(pattern, new, text)
        return text

    return change


def leaves(change: Callable[[str, Any], Any]) -> Callable[[str], str]:
    """The change of a JSON text that changes every value, which it is given with its path, names with dots between."""

    def below(value: Any, path: str) -> Any:
        if isinstance(value, dict):
            return {name: below(one, f"{path}.{name}") for name, one in value.items()}
        return [below(one, path) for one in value] if isinstance(value, list) else change(path, value)

    return lambda text: json.dumps(below(json.loads(text), ""), indent=1)


def _unmeasured(path: str, value: Any) -> Any:
    """A figure of `bench`, unless a clock measured it, or it is computed from such."""
    timed = re.match(r"\.measured|\.machine|\.energy\..*(work|encoding|total)|\.peers\..*(per_second|threads)", path)
    return f"<{type(value).__name__}>" if timed else value


def _rounded(text: str) -> str:
    """Figures of `eval` with the confidences of curves on nine digits."""
    long = re.compile(r"\d+\.\d{9,}")
    return re.sub(r'"threshold": \[[^]]*', lambda one: long.sub(lambda x: f"{float(x[0]):.9f}", one[0]), text)


_NUMBERS = replaced(r"\d[\d.,]*(e[+-]\d+)?", "#", r"[ ─━]+", " ", r"(?<=# )[GMk]?B\b", "B")
_DOCTOR = replaced(
    *(r", Python .* processors", "", r"(?s)│ Chromium.*?└", "└", r"\d+(\.\d+)+", "<version>", r"[ ─━]+", " ")
)
RULES = (
    Rule("asking/*", "f.json", _rounded, "the last bits of matrix products differ between kinds of processors"),
    Rule("*", "std*", replaced(r"\bin \d+\.\d s\b", "in <clock> s"), "seconds of the clock"),
    Rule(
        "*",
        "std*",
        replaced(
            r" \(and \d+ s compiling, in the first run alone\)", "", r"note: compiling kernels \(first run\)\n", ""
        ),
        "a cache of kernels",
    ),
    Rule("*", "std*", replaced(r"127\.0\.0\.1:\d+", "127.0.0.1:<port>"), "a free port"),
    Rule("boards/bench*", "stdout", _NUMBERS, "numbers, and widths of columns, that a clock measured"),
    Rule("boards/bench*", "f.json", leaves(_unmeasured), "what a clock measured, and energies computed from it"),
    Rule(
        "boards/bench*",
        "*.html",
        replaced(
            r"(?s)<svg.*?</svg>", "", r"(<dt>processor</dt><dd>).*?(?=</dd>)", r"\1#", r"\d[\d.,]*(e[+-]\d+)?", "#"
        ),
        "such, pictures of them, and the machine's processor",
    ),
    Rule("boards/verify*", "f.json", replaced(r"installed for \S+;", "installed for <python>;"), "a path"),
    Rule("boards/run-*-ladder", "ladder.json", replaced(r"[^\s\"]+ has no nxsdk", "<python> has no nxsdk"), "a path"),
    Rule("tables/doctor*", "stdout", _DOCTOR, "packages and machine"),
    Rule("boards/run-*-ladder", "ladder.json", replaced(r"Linux-[^\"]+", "<machine>"), "the machine"),
    Rule("tables/paper-keep", "k/*.json", replaced(r"[0-9a-f]{64}", "<sources>"), "the sources that computed it"),
)


class Part(NamedTuple):
    """A part of what a case gave: its name, and its bytes once `RULES` have been applied."""

    name: str
    data: bytes


def parts_of(folder: Path, key: str) -> Iterator[Part]:
    """The streams and files that a case gave."""
    for path in [folder / "stdout", folder / "stderr", *sorted((folder / "files").rglob("*"))]:
        if path.is_file():
            name = str(path.relative_to(folder / "files")) if path.parent != folder else path.name
            data = path.read_bytes()
            for rule in RULES:
                if fnmatch(key, rule.cases) and fnmatch(name, rule.parts):
                    data = rule.change(data.decode()).encode()
            yield Part(name, data)


def entry_of(folder: Path, key: str) -> dict[str, Any]:
    """The entry of a case in the record, from the folder that keeps what it gave."""
    entry = dict(json.loads((folder / "case.json").read_text(encoding="utf-8")))
    crowds: dict[str, list[Part]] = defaultdict(list)
    for part in parts_of(folder, key):
        path = Path(part.name)
        crowds[str(path.parent / f"*{path.suffix}")].append(part)
    for name, crowd in crowds.items():
        if len(crowd) > CROWD:
            listed = "".join(f"{part.name} {_digest(part.data)}\n" for part in crowd)
            entry[f"{name} ({len(crowd)} files)"] = _digest(listed.encode())
        else:
            entry.update((part.name, _shown(part)) for part in crowd if part.data or part.name not in LONGEST)
    return entry


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _shown(part: Part) -> str | list[str]:
    """Lines of a short text; of all else the digest and the size."""
    try:
        text = part.data.decode()
    except UnicodeDecodeError:
        text = ""
    if text and len(text) <= LONGEST.get(part.name, LONGEST_FILE):
        return text.splitlines()
    return f"{_digest(part.data)}, {len(part.data)} bytes"


def record_of(captured: Path) -> dict[str, Any]:
    """The record of a folder that `golden.running.run_all` has filled."""
    folders = sorted(path.parent for path in captured.rglob("case.json"))
    keys = {folder: str(folder.relative_to(captured)) for folder in folders}
    return {key: entry_of(folder, key) for folder, key in keys.items() if len(Path(key).parts) == 2}


def read() -> dict[str, Any]:
    """The committed record."""
    return dict(json.loads(RECORD.read_text(encoding="utf-8")))


def write(record: dict[str, Any]) -> None:
    """Commit a record: a line for each short line of text, and for each digest."""
    RECORD.write_text(json.dumps(record, indent=1, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8")
