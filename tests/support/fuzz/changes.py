"""Changes of honest files, drawn from one generator: JSON values, arrays, text, archives, containers, bundles, bytes.

Used by events, matching, storage, support and vectors.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import random
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Files = dict[str, bytes]
Entries = list[tuple[str, bytes]]
"""Names in an archive and what they hold, in order."""

MANIFEST, REFERENCES = "manifest.json", "host/references.lvpr"
SPECIAL = b"\0special\0"
"""What stands before a content that is none: ``fifo``, ``folder``, ``missing`` or ``link TARGET``."""

ODD: tuple[Any, ...] = (None, True, False, 0, 1, -1, 7, 2**31, 2**63, 10**30, -(10**30), 0.0, 0.5, -0.5, 1e308)
ODD += (5e-324, float("nan"), float("inf"), -float("inf"), 10**4000, [], {}, [0], [[0]], {"a": 0})
ODD += ("", "1", "nan", "x" * 5000, "a\0b", "\x1b[31mred\r\n", "\ud800", "../../etc/passwd")
DEEP = b"[" * 3000 + b"]" * 3000
WORDS = (
    "nan -inf true 0 -1 0.5 1e999 0x7f 1_000 1__0 01 word 'bias' 'conductance' 'paper' [1,2] {a=1} 1979-05-27 \"\" "
    '"a\\u0000b" "\\ud800" "\\u001b[31m" "unclosed ../query/missing.png /dev/zero ../query concat:a|b pipe:0 # = ,,,, '
    "[network] [[network]] [unknown] preset=3 seed=-1 a.b.c.d=1 image,image lat,lon,x,y \u0663"
).split(" ")
WORDS += ["", "\0", "a\rb", "\u2028", "\ufeff", "9" * 10_000, "x" * 5000, "[" * 3000, ".".join("a" * 2000) + " = 1"]
TYPES = "u1 i1 u2 i2 <i4 >i4 u4 i8 u8 f2 f4 >f4 f8 ? c16 S3 U2 M8[s]".split()


def value(rng: random.Random, honest: Any) -> bytes:
    """The JSON text of ``honest`` with one value replaced, nearly kept, dropped, added, renamed or exchanged."""
    changed = json.loads(json.dumps(honest))
    places = list(_places(changed))
    holder, key = rng.choice([p for p in places if p[0] is changed] if rng.random() < 0.4 else places)
    kind = rng.randrange(9)
    if kind < 3:
        holder[key] = rng.choice(ODD)
    elif kind < 6:
        holder[key] = _near(rng, holder[key])
    elif kind == 6:
        del holder[key]
    elif kind == 7:
        other, at = rng.choice(places)
        holder[key], other[at] = other[at], holder[key]
    elif isinstance(holder, dict):
        holder[rng.choice([key + "_", key.upper(), "", "0", *holder])] = (
            holder[key] if rng.random() < 0.5 else holder.pop(key)
        )
    else:
        holder.append(rng.choice(ODD))
    text = json.dumps(changed).encode()
    return raw(rng, text) if rng.random() < 0.05 else text.replace(b"7", DEEP, 1) if rng.random() < 0.02 else text


def _places(holder: Any) -> Any:
    """Every list or dictionary in ``holder``, with the index or key of each of its values."""
    for key in list(holder) if isinstance(holder, dict) else range(len(holder)):
        yield holder, key
        if isinstance(holder[key], (dict, list)) and holder[key]:
            yield from _places(holder[key])


def _near(rng: random.Random, honest: Any) -> Any:
    """A value not far away, or the same of another type."""
    if isinstance(honest, bool) or honest is None:
        return rng.choice([not honest, int(bool(honest)), str(honest).lower()])
    if isinstance(honest, (int, float)):
        return rng.choice(
            [honest + 1, honest - 1, -honest, honest * 2, honest / 2, float(honest), str(honest), [honest]]
        )
    if isinstance(honest, str):
        return rng.choice([honest.upper(), honest[:-1], honest + honest, honest + " ", [honest]])
    return [*honest, *honest][: rng.randrange(2 * len(honest) + 1)] if isinstance(honest, list) else [honest]


def stored(array: NDArray[Any]) -> bytes:
    """``array`` as an npy file, in its own order and byte order; objects as a pickle."""
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array)
    return buffer.getvalue()


def held(data: bytes) -> NDArray[Any]:
    """The array of an honest npy file."""
    return np.array(np.lib.format.read_array(io.BytesIO(data), allow_pickle=False))


def lying(descr: str, shape: object, data: bytes) -> bytes:
    """An npy file whose header says what it is told to."""
    header = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode("latin-1")
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


LIES: list[Any] = [(10**12,), (2**62, 4), (-1,), "(0.5,)", f"({'9' * 5000},)", "'many'", "(" * 2000]
LYING_TYPES = ("<q9", "|V2147483647", "<f4'+__import__('os').name+'")
"""Shapes and types of headers that lie."""


def array(rng: random.Random, honest: NDArray[Any]) -> bytes:
    """The npy file of ``honest`` with another type, shape, order or value, or with a header that lies."""
    kind, shape = rng.randrange(8), honest.shape
    if kind == 0:
        name = rng.choice(TYPES)
        with np.errstate(all="ignore"), contextlib.suppress(TypeError, ValueError):
            return stored(honest.astype(name)) if rng.random() < 0.8 else stored(honest.astype(object))
        return stored(np.zeros(shape, name))
    if kind == 1:
        shapes = [honest[None], honest[:-1], honest[1:], np.concatenate([honest, honest]), honest[:0], honest.T]
        shapes += [honest[::-1], honest[..., :-1], honest[..., None], honest.reshape(-1), np.asfortranarray(honest)]
        return stored(rng.choice([*shapes, np.resize(honest, 4096)]))
    if kind == 2:
        own, lies = (honest.dtype.str, honest.tobytes()), [*LIES, (shape[0] + 1, *shape[1:])]
        odd = [lying(own[0], lie, own[1]) for lie in lies] + [lying(name, shape, own[1]) for name in LYING_TYPES]
        return rng.choice([*odd, stored(honest) + b"more", stored(honest)[:-1], stored(honest)[:20], b"", b"hello"])
    if honest.size == 0:
        return stored(honest)
    flat = honest.reshape(-1)
    at = slice(None) if rng.random() < 0.1 else rng.randrange(flat.size)
    if kind == 3:
        flat[at] = flat[rng.randrange(flat.size)]
    elif kind == 4:
        with np.errstate(all="ignore"):
            flat[at] = flat[at] + np.array(rng.choice([1, 2, 100])).astype(flat.dtype)
    elif kind == 5:
        flat.view(np.uint8)[rng.randrange(flat.nbytes)] ^= 1 << rng.randrange(8)
    elif flat.dtype.kind == "f":
        info = np.finfo(flat.dtype)
        flat[at] = rng.choice([np.nan, np.inf, -np.inf, -1.0, -0.0, info.max, info.tiny, 1e30, 0.5, 0.0, -1e-9])
    else:
        ends = (0, 1) if flat.dtype.kind == "b" else (np.iinfo(flat.dtype).min, np.iinfo(flat.dtype).max)
        flat[at] = rng.choice([*ends, *(n for n in (-1, 0, 1, 8, 255, 4096, 65_536) if ends[0] <= n <= ends[1])])
    return stored(honest)


def text(rng: random.Random, honest: bytes) -> bytes:
    """Lines and words of a text dropped, doubled, moved or replaced, or its bytes changed."""
    if rng.random() < 0.25:
        return raw(rng, honest)
    lines = honest.decode().split("\n")
    at, kind = rng.choice([k for k, line in enumerate(lines) if line]), rng.randrange(8)
    words = re.split(r"([,=:;\s]+)", lines[at])

    def replace() -> None:
        place = rng.randrange(0, len(words), 2)
        near = [words[place] + end for end in ("0", "000000", ".5", "e3", "e40", "_")]
        near += [start + words[place] for start in ("-", "0.")]
        words[place] = rng.choice(WORDS if kind < 7 else near)

    changes: tuple[Callable[[], object], ...] = (
        lambda: lines.pop(at),
        lambda: lines.insert(rng.randrange(len(lines) + 1), lines[at]),
        lambda: lines.insert(at, rng.choice(WORDS)),
        lambda: words.insert(rng.randrange(len(words) + 1), rng.choice([",", " ", rng.choice(WORDS)])),
        lambda: words.pop(rng.randrange(len(words))),
    )
    changes[kind]() if kind < len(changes) else replace()
    if kind > 2:
        lines[at] = "".join(words)
    return "\n".join(lines).encode("utf-8", "surrogatepass")


INSIDE = [b"\0", b"\r", b"\xff", b"\x1b[2J", b"\xed\xa0\x80", b'"', b"\\", b"\x0c"]
WHOLE = [b"", b"\n\n", bytes(1000), b"#\n", b"lava-vpr", b"lava-vpr model 1\n"]


def raw(rng: random.Random, honest: bytes) -> bytes:
    """A bit turned, bytes cut, added or exchanged, another encoding, or hardly anything."""
    at = rng.randrange(len(honest) or 1)
    changes: tuple[Callable[[], bytes], ...] = (
        lambda: honest[:at] + bytes([honest[at] ^ 1 << rng.randrange(8)]) + honest[at + 1 :],
        lambda: honest[:at],
        lambda: honest[:at] + rng.choice(INSIDE) + honest[at:],
        lambda: rng.choice([b"\n", b"x", b"\xef\xbb\xbf", bytes(64)]) + honest,
        lambda: honest + rng.choice([b"\n", b"x", bytes(64), honest]),
        lambda: honest.decode("latin-1").encode(rng.choice(["utf-16", "utf-32", "utf-16-le"])),
        lambda: honest.replace(b"\n", rng.choice([b"\r\n", b"\r", b"\0"])),
        lambda: rng.choice([*WHOLE, honest[:20], b'"' * 999]),
    )
    return rng.choice(changes)()


def taken_apart(data: bytes) -> tuple[bytes, Entries]:
    """The magic line of an honest container, and its entries."""
    magic, _, payload = data.split(b"\n", 2)
    with zipfile.ZipFile(io.BytesIO(payload)) as opened:
        return magic, [(info.filename, opened.read(info)) for info in opened.infolist()]


def sealed(magic: bytes, payload: bytes) -> bytes:
    """A container with the right checksum of ``payload``."""
    return magic + b"\n" + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload


def zipped(entries: Entries, method: int = zipfile.ZIP_DEFLATED, level: int = 1) -> bytes:
    """The archive of ``entries``."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a name twice
        for name, data in entries:
            archive.writestr(zipfile.ZipInfo(name), data, method, level)
    return buffer.getvalue()


def bomb(name: str, head: bytes, size: int, told: int) -> bytes:
    """An archive of one entry that unpacks to ``head`` and ``size`` zeros, and says that it is ``told`` bytes."""
    block, deflater = 1 << 22, zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = deflater.compress(head) + deflater.flush(zlib.Z_FULL_FLUSH)
    deflater = zlib.compressobj(9, zlib.DEFLATED, -15)  # blocks of zeros can follow each other
    packed += (deflater.compress(bytes(block)) + deflater.flush(zlib.Z_FULL_FLUSH)) * (size // block) + b"\x03\0"
    payload = bytearray(zipped([(name, packed)], zipfile.ZIP_STORED))
    for place, first in ((0, 8), (payload.index(b"PK\x01\x02"), 10)):
        payload[place + first : place + first + 2] = struct.pack("<H", zipfile.ZIP_DEFLATED)
        payload[place + first + 14 : place + first + 18] = struct.pack("<I", told)
    return bytes(payload)


OTHERS = ["../up.npy", "/abs.npy", "a.npy", "header", "x" * 3000, "a.extra.npy"]
"""Names of entries that no container has."""


def payload(rng: random.Random, entries: Entries, other: Entries) -> bytes:
    """The archive of ``entries``, some dropped, doubled, renamed, exchanged or of ``other``, or bits of it turned."""
    at = rng.randrange(len(entries))
    (name, data), theirs, plain = entries[at], dict(other), zipped(entries)
    directory = plain.index(b"PK\x01\x02")

    def exchanged() -> bytes:
        names = rng.sample([n for n, _ in entries], len(entries))
        return zipped([(n, d) for n, (_, d) in zip(names, entries, strict=True)])

    def unpacking_to(size: int) -> bytes:
        head = lying("|u1", (size,), b"")
        return bomb(name, head, size, rng.choice([size + len(head), 0xFFFFFFF0, len(head), 1 << 20]))

    def turned(place: int) -> bytes:
        return plain[:place] + bytes([plain[place] ^ 1 << rng.randrange(8)]) + plain[place + 1 :]

    changes: tuple[Callable[[], bytes], ...] = (
        lambda: zipped(entries[:at] + entries[at + 1 :]),
        lambda: zipped([*entries, (name, array(rng, held(data)))]),
        lambda: zipped([*entries, (rng.choice(OTHERS), data)]),
        lambda: zipped([(rng.choice([name.upper(), name[:-4]]) if n == name else n, d) for n, d in entries]),
        exchanged,
        lambda: zipped([(n, theirs.get(n, d) if rng.random() < 0.3 else d) for n, d in entries]),
        lambda: zipped(entries, rng.choice([zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])),
        lambda: unpacking_to(3 << 30),
        lambda: turned(rng.randrange(directory, len(plain))),
        lambda: turned(rng.randrange(directory)),
    )
    return rng.choice(changes)()


def container(rng: random.Random, honest: bytes, others: Mapping[str, bytes]) -> bytes:
    """A changed container, in most cases with a right checksum; ``others`` are honest, too, for exchanges."""
    draw, other = rng.random(), others[rng.choice(sorted(others))]
    if draw < 0.08:
        return raw(rng, honest)
    magic, entries = taken_apart(honest)
    if draw < 0.1:
        magic = rng.choice([b"lava-vpr model 2", b"lava-vpr \x1b[31m 1", b"lava-vpr checkpoint 1", magic + b"\r"])
    elif draw < 0.28:
        return sealed(magic, payload(rng, entries, taken_apart(other)[1]))
    header = held(dict(entries)["header.npy"]).tobytes()
    at = "header.npy" if draw < 0.6 else rng.choice(entries)[0]
    if draw < 0.6:
        made = stored(np.frombuffer(value(rng, json.loads(header)), np.uint8))
    else:
        made = array(rng, held(dict(entries)[at]))
    return sealed(magic, zipped([(name, made if name == at else data) for name, data in entries]))


def digest(manifest: Mapping[str, Any]) -> str:
    """SHA-256 of a manifest without its own."""
    rest = {key: value for key, value in manifest.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def sealed_bundle(files: Files, manifest: dict[str, Any] | None = None) -> Files:
    """``files`` with a manifest that is right about them; without one, with the old one's other values."""
    whole: dict[str, Any] = dict(manifest or json.loads(files[MANIFEST]))
    rest = {name: data for name, data in files.items() if name != MANIFEST}
    whole["files"] = {n: {"bytes": len(d), "sha256": hashlib.sha256(d).hexdigest()} for n, d in rest.items()}
    whole["sha256"] = digest(whole)
    return files | {MANIFEST: json.dumps(whole).encode()}


NAMES = (
    "../up.txt /etc/hostname back\\slash host . host//rates.npy ./host/rates.npy missing.npy manifest.json "
    "host/rates.npy/inner learning/extra.npy cores/chip9-core999/registers.json cores/other/registers.json"
).split()
NAMES += ["", "a\0b", "x" * 300, "\x1b[2J", "\ud800"]


def bundle(rng: random.Random, files: Files, others: Mapping[str, Files]) -> Files:
    """The files of a bundle, one of them changed, missing, foreign or none, most of them sealed again."""
    name, kind = rng.choice(sorted(set(files) - {MANIFEST})), rng.randrange(16)
    if kind == 0:
        return files | {name: raw(rng, files[name])}
    if kind == 1:
        specials = (b"fifo", b"folder", b"missing", b"link /dev/zero", b"link /dev/null", b"link " + name.encode())
        return files | {rng.choice([name, MANIFEST]): SPECIAL + rng.choice(specials)}
    if kind == 2:
        return sealed_bundle({n: data for n, data in files.items() if n != name})
    if kind == 3:
        return sealed_bundle(files | {name: others[rng.choice(sorted(others))].get(name, b"{}")})
    if kind < 7:
        return _manifest(rng, files, name)
    if kind < 9:
        kept = {other: content[REFERENCES] for other, content in others.items()}
        return sealed_bundle(files | {REFERENCES: container(rng, files[REFERENCES], kept)})
    suffix = ".npy" if kind < 13 else ".json"
    name = rng.choice([n for n in sorted(files) if n.endswith(suffix) and n != MANIFEST])
    made = array(rng, held(files[name])) if suffix == ".npy" else value(rng, json.loads(files[name]))
    return sealed_bundle(files | {name: made})


def _manifest(rng: random.Random, files: Files, name: str) -> Files:
    """Other values, names or facts in the manifest, its own checksum right again where it can be."""
    whole = json.loads(files[MANIFEST])
    draw = rng.random()
    if draw < 0.3:
        whole["files"][rng.choice(NAMES)] = whole["files"].pop(name) if draw < 0.15 else whole["files"][name]
    elif draw < 0.5:
        whole["files"][name][rng.choice(["bytes", "sha256", "more"])] = rng.choice(ODD)
    else:
        rest = {key: whole.pop(key) for key in ("files", "sha256")}
        try:
            whole = json.loads(value(rng, whole)) | rest
        except (ValueError, TypeError, RecursionError):
            return files | {MANIFEST: DEEP}
    with contextlib.suppress(ValueError, TypeError):
        whole["sha256"] = digest(whole)
    return files | {MANIFEST: json.dumps(whole).encode()}
