"""Mutations of bundles, most of them sealed again with the right sizes and checksums.

Used by storage and support.
"""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from support.fuzz.files import arrays, containers, values

MANIFEST, REFERENCES = "manifest.json", "host/references.lvpr"
Files = dict[str, bytes]
RAW_MARK = b"\0raw\0"
"""What stands before a special content: ``fifo``, ``folder``, ``link TARGET`` or ``missing``."""


def digest(manifest: Mapping[str, Any]) -> str:
    """SHA-256 of a manifest without its own."""
    rest = {key: value for key, value in manifest.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def sealed(files: Files, manifest: dict[str, Any] | None = None) -> Files:
    """``files`` with a manifest that is right about them; without one, with the old one's other values."""
    whole: dict[str, Any] = dict(manifest or json.loads(files[MANIFEST]))
    whole["files"] = {
        name: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        for name, data in files.items()
        if name != MANIFEST
    }
    whole["sha256"] = digest(whole)
    return files | {MANIFEST: json.dumps(whole).encode()}


def _of_kind(files: Files, *suffixes: str) -> list[str]:
    return sorted(name for name in files if name.endswith(suffixes) and name != MANIFEST)


def _array(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    name = rng.choice(_of_kind(files, ".npy"))
    made, told = arrays.changed(rng, arrays.read(files[name]))
    return sealed(files | {name: made}), f"{name}: {told}"


def _json(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    name = rng.choice([found for found in _of_kind(files, ".json") if found != "mapping.json"] or ["mapping.json"])
    made, told = values.changed(rng, json.loads(files[name]))
    return sealed(files | {name: made}), f"{name}: {told}"


def _references(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    kept = {name: other[REFERENCES] for name, other in others.items()}
    made, told = containers.changed(rng, files[REFERENCES], kept)
    return sealed(files | {REFERENCES: made}), f"{REFERENCES}: {told}"


def _manifest(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    """Values of the manifest, its own checksum right again where it can be."""
    whole = json.loads(files[MANIFEST])
    listed = whole.pop("files")
    whole.pop("sha256")
    text, told = values.changed(rng, whole if rng.random() < 0.7 else whole | {"files": dict([*listed.items()][:3])})
    try:
        value = json.loads(text)
        value.setdefault("files", listed)
        value["sha256"] = digest(value)
        again = json.dumps(value).encode()
    except (ValueError, TypeError, AttributeError, RecursionError):
        again = text
    return files | {MANIFEST: again}, f"{MANIFEST}: {told}"


NAMES = (
    "../up.txt",
    "/etc/hostname",
    "a\0b",
    "back\\slash",
    "host",
    "cores",
    "",
    ".",
    "host/../host/rates.npy",
    "host//rates.npy",
    "./host/rates.npy",
    "x" * 300,
    "missing.npy",
    "manifest.json",
    "\x1b[2J",
    "\ud800",
    "host/rates.npy/inner",
    "cores/chip9-core999/registers.json",
    "cores/chip-core/registers.json",
    "cores/chip0-core000-1/registers.json",
    "cores/other/registers.json",
    "learning/extra.npy",
    "PROGRAM/run.py",
)


def _names(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    """Odd names in the list of files, sealed; some of them stand there, too."""
    whole = json.loads(files[MANIFEST])
    name, model = rng.choice(NAMES), rng.choice(sorted(whole["files"]))
    facts = whole["files"][model]
    replaced = rng.random() < 0.5
    if replaced:
        del whole["files"][model]
    whole["files"][name] = facts
    whole["sha256"] = digest(whole)
    made = files | {MANIFEST: json.dumps(whole).encode()}
    if rng.random() < 0.7 and _harmless(name):
        made[name] = files[model]
    return made, f"{model} {'is called' if replaced else 'is also called'} {name[:30]!r}"


def _harmless(name: str) -> bool:
    """Whether a file of that name may be written below the bundle's folder."""
    plain = name.isprintable() and name.isascii() and 0 < len(name) < 200
    return (
        plain
        and name not in ("host", "cores", ".", MANIFEST)
        and ".." not in name
        and name[0] != "/"
        and "inner" not in name
    )


def _facts(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    """Wrong facts about a file."""
    whole = json.loads(files[MANIFEST])
    name = rng.choice(sorted(whole["files"]))
    facts: Any = whole["files"][name]
    odd = rng.choice(values.ODD_VALUES[:34])
    kind = rng.randrange(4)
    if kind == 3:
        whole["files"][name] = odd
    else:
        facts[("bytes", "sha256", "more")[kind]] = odd
    try:
        whole["sha256"] = digest(whole)
        text = json.dumps(whole).encode()
    except (TypeError, ValueError):
        text = json.dumps(whole).encode()
    return files | {MANIFEST: text}, f"facts of {name}: {str(odd)[:30]!r}"


def _present(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    """Files left out or put in, with a manifest that is right."""
    name = rng.choice(sorted(set(files) - {MANIFEST}))
    if rng.random() < 0.6:
        return sealed({n: data for n, data in files.items() if n != name}), f"without {name}"
    other = others[rng.choice(sorted(others))]
    more = rng.choice(sorted(set(other) - {MANIFEST}))
    return sealed(files | {more: other[more]}), f"{more} of another bundle"


def _exchanged(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    names = _of_kind(files, ".npy", ".json")
    first, second = rng.sample(names, 2)
    return sealed(files | {first: files[second], second: files[first]}), f"{first} and {second} exchanged"


def _numbers(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    """The network's numbers in the manifest, and where they are told a second time."""
    whole = json.loads(files[MANIFEST])
    name = rng.choice(sorted(whole["network"]))
    value = rng.choice([values.near(rng, whole["network"][name]), *values.ODD_VALUES[:20]])
    whole["network"][name] = value
    made, second = dict(files), "network/parameters.json"
    if second in files:
        parameters = json.loads(files[second])
        if name in parameters["network"]:
            parameters["network"][name] = value
        if name in parameters:
            parameters[name] = value
        made[second] = json.dumps(parameters).encode()
    return sealed(made, whole), f"network.{name} is {str(value)[:30]!r}"


def _special(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    """Something else where a file should be."""
    name = rng.choice(sorted(files))
    kinds = [b"fifo", b"folder", b"missing", b"link /dev/zero", b"link /dev/null", b"link " + name.encode()]
    kind = rng.choice(kinds)
    return files | {name: RAW_MARK + kind}, f"{name}: {kind.decode()}"


def _unsealed(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    """A file that no longer fits its checksum."""
    name = rng.choice(sorted(files))
    data = bytearray(files[name])
    if not data or rng.random() < 0.5:
        return files | {name: bytes(data[: len(data) // 2])}, f"{name}: cut off"
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return files | {name: bytes(data)}, f"{name}: a bit turned"


def _words(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    """Bits of the network's memory, registers' tables and host's tables turned, and sealed."""
    names = [name for name in _of_kind(files, ".npy") if name.startswith(("cores", "network", "host", "learning"))]
    name = rng.choice(names)
    array = np.array(arrays.read(files[name]))
    if array.size:
        raw = array.reshape(-1).view(np.uint8)
        raw[rng.randrange(raw.size)] ^= 1 << rng.randrange(8)
    return sealed(files | {name: arrays.stored(array)}), f"{name}: a bit turned"


_CHANGES: tuple[tuple[float, Callable[[random.Random, Files, Mapping[str, Files]], tuple[Files, str]]], ...] = (
    (7, _array),
    (6, _json),
    (3, _references),
    (3, _manifest),
    (2, _names),
    (1, _facts),
    (1.5, _present),
    (1, _exchanged),
    (2, _numbers),
    (1, _special),
    (1, _unsealed),
    (3, _words),
)


def changed(rng: random.Random, files: Files, others: Mapping[str, Files]) -> tuple[Files, str]:
    """The files of a changed bundle, and what was changed."""
    weights, changes = zip(*_CHANGES, strict=True)
    return rng.choices(changes, weights)[0](rng, files, others)
