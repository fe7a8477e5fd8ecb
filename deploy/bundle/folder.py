"""The bundle: a folder that holds everything a board needs to run a model, and refuses to be used once altered.

``manifest.json`` lists every file with its size and SHA-256, and carries a SHA-256 of itself. Files are read once,
checked, and used from memory: what was checked is what runs. Equal models give equal bytes: no dates, no paths.
"""

from __future__ import annotations

import ctypes
import hashlib
import io
import json
import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.errors import BundleError, brief, shown
from lava_vpr.interrupts import held
from lava_vpr.settings.ranges import whole
from lava_vpr.storage.arrays import Shape, array_of
from lava_vpr.storage.limits import excess
from lava_vpr.storage.reading import open_regular, parse_json, read_bytes
from lava_vpr.storage.writing import folder_beside, read_only, written

FORMAT, VERSION = "lava-vpr bundle", 1
MANIFEST = "manifest.json"
AGAIN = "deploy the model again or fetch an intact copy"
_NAME = re.compile(r"(?!.{201})[A-Za-z0-9_][A-Za-z0-9._-]*(/[A-Za-z0-9_][A-Za-z0-9._-]*)*")
"""Names of files: plain letters, digits, ``.``, ``_`` and ``-``, at most 200, and below the folder."""


@dataclass(frozen=True)
class ReadBundle:
    """A bundle that was read and found intact.

    Attributes:
        path: The folder that it was read from.
        manifest: What the bundle says of itself.
        files: Content of every file in the manifest, by its name relative to the folder.
    """

    path: Path
    manifest: dict[str, Any] = field(repr=False)
    files: dict[str, bytes] = field(repr=False)

    @property
    def target(self) -> str:
        """The name of the bundle's board, a key of `lava_vpr.deploy.boards.board.BOARDS`."""
        return str(self.manifest["target"])

    def at(self, name: str) -> str:
        """Where the bundle's file ``name`` stands, for a message."""
        return shown(self.path / name)

    def data(self, name: str) -> bytes:
        """The content of the bundle's file ``name``, in bytes.

        Raises:
            BundleError: the bundle has none of that name.
        """
        if name not in self.files:
            raise BundleError(f"{self.at(name)}: the bundle lacks this file; {AGAIN}")
        return self.files[name]

    def array(self, name: str, kind: DTypeLike = None, shape: Shape | None = None) -> NDArray[Any]:
        """The array in a ``.npy`` file.

        Args:
            name: The file.
            kind, shape: The type and shape that it must have, as `lava_vpr.storage.arrays.array_of` takes them.
        Raises:
            BundleError: missing, no array, or another than this.
        """
        try:
            return array_of(self.data(name), kind, shape).copy()
        except ValueError as error:
            raise BundleError(f"{self.at(name)}: {error}; {AGAIN}") from None

    def json(self, name: str) -> Any:
        """The value in a ``.json`` file.

        Raises:
            BundleError: missing, too long, or no JSON.
        """
        data = self.data(name)
        beyond = excess("bundle_json_bytes", len(data))
        if beyond is not None:
            raise BundleError(f"{self.at(name)}: has {beyond}")
        try:
            return _strict_json(data)
        except ValueError as error:
            raise BundleError(f"{self.at(name)}: is no JSON ({error}); {AGAIN}") from None

    def demand(self, files: Mapping[str, bytes]) -> None:
        """Refuse the bundle unless it holds these ``.json`` and ``.npy`` files, with the same values if not bytes.

        Raises:
            BundleError: naming one that is missing or has other values.
        """
        for name, data in files.items():
            if self.data(name) == data:
                continue
            if name.endswith(".json"):
                held, wanted = (json.dumps(value, sort_keys=True) for value in (self.json(name), json.loads(data)))
                equal = held == wanted  # as JSON has them: true and 1.0 are not 1
            else:
                array = array_of(data)
                equal = np.array_equal(self.array(name, array.dtype, array.shape), array)
            if not equal:
                raise BundleError(f"{self.at(name)}: contradicts the rest of the bundle; {AGAIN}")


def array_bytes(array: NDArray[Any]) -> bytes:
    """``array`` as a ``.npy`` file: version 1, C order, little endian."""
    buffer = io.BytesIO()
    plain = np.ascontiguousarray(array)
    np.lib.format.write_array(buffer, plain.astype(plain.dtype.newbyteorder("<")), version=(1, 0), allow_pickle=False)
    return buffer.getvalue()


def json_bytes(value: Any) -> bytes:
    """``value`` as JSON for people and programs; equal values give equal bytes."""
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()


def _strict_json(data: bytes) -> Any:
    """The value of JSON of which two readers cannot think differently.

    Raises:
        ValueError: no JSON, or one that breaks its reader (`lava_vpr.storage.reading.parse_json`), or an object that
            says a key twice.
    """
    return parse_json(data, object_pairs_hook=_without_repeats)


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("an object says a key twice")
    return found


def self_digest(manifest: Mapping[str, Any]) -> str:
    """SHA-256 of a manifest without its own key ``sha256``."""
    rest = {key: value for key, value in manifest.items() if key != "sha256"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def sealed(manifest: Mapping[str, Any], files: Mapping[str, bytes]) -> dict[str, Any]:
    """``manifest`` with format, version, the list of ``files`` and its own checksum."""
    listed = {
        name: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()} for name, data in sorted(files.items())
    }
    whole = {"format": FORMAT, "version": VERSION, **manifest, "files": listed}
    return {**whole, "sha256": self_digest(whole)}


def check_replaceable(path: Path) -> None:
    """Refuse to replace what is no bundle, before any work is done.

    Raises:
        BundleError: a file, or a folder that holds something else; it, or something in it, is read-only; or the folder
            above is missing or closed to us.
    """
    above = path.absolute().parent
    if not above.is_dir():
        raise BundleError(f"{shown(path)}: the folder {shown(above)} does not exist; create it first")
    if not os.access(above, os.W_OK):
        raise BundleError(f"{shown(path)}: no permission to write in {shown(above)}; choose another place")
    if not path.exists() and not path.is_symlink():
        return
    if not path.is_dir() or path.is_symlink():
        raise BundleError(f"{shown(path)}: is no folder, and a bundle is one; name another")
    if not any(path.iterdir()):
        return
    try:
        manifest = _strict_json(read_bytes(path / MANIFEST, "bundle_json_bytes"))
        ours = manifest["format"] == FORMAT and isinstance(manifest["files"], dict)
        known = {*manifest["files"], MANIFEST} if ours else set()
    except (OSError, ValueError, KeyError, TypeError):
        known = set()
    if not known:
        raise BundleError(f"{shown(path)}: holds something else than a bundle; name another folder")
    files = (file.relative_to(path) for file in path.rglob("*") if not file.is_dir())
    foreign = [name for name in files if name.as_posix() not in known and "__pycache__" not in name.parts]
    if foreign:
        name = shown(min(foreign))
        raise BundleError(
            f"{shown(path)}: holds {name}, which is no part of the bundle; move it or name another folder"
        )
    closed = next((entry for entry in (path, *sorted(path.rglob("*"))) if entry.exists() and read_only(entry)), None)
    if closed is not None:
        raise BundleError(
            f"{shown(closed)}: is read-only and would be replaced; make it writable or name another folder"
        )


def write(path: Path, manifest: Mapping[str, Any], files: Mapping[str, bytes]) -> ReadBundle:
    """Write a bundle; it appears complete or not at all, and replaces an older one in one step.

    Of what it replaces it keeps the permissions: those of the folder, and those of each file that was there.

    Args:
        path: The folder.
        manifest: Without format, version, files and checksum.
        files: Content by name.
    Raises:
        BundleError: it cannot be written; what stood there still does.
    """
    check_replaceable(path)
    whole = sealed(manifest, files)
    with written(path, "the bundle ", BundleError), folder_beside(path) as temporary:
        for name, data in (*sorted(files.items()), (MANIFEST, json_bytes(whole))):
            target = temporary / name
            target.parent.mkdir(parents=True, exist_ok=True)
            with target.open("wb") as file:
                file.write(data)
                file.flush()
                if (before := path / name).is_file():
                    os.fchmod(file.fileno(), stat.S_IMODE(before.stat().st_mode))
                os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(stat.S_IMODE(path.stat().st_mode) if path.exists() else 0o777 & ~umask)
        with held():
            _put(temporary, path)  # after an exchange the old bundle is the temporary one
    return ReadBundle(path, whole, dict(files))


def _put(new: Path, path: Path) -> None:
    """Put the folder ``new`` at ``path``; if that exists, exchange the two."""
    if not path.exists():
        new.rename(path)
        return
    libc = ctypes.CDLL(None, use_errno=True)
    here, exchange = -100, 2  # AT_FDCWD, RENAME_EXCHANGE
    try:
        failed = libc.renameat2(here, os.fsencode(new.absolute()), here, os.fsencode(path.absolute()), exchange)
    except AttributeError:
        failed = -1
    if failed:  # an old system, or a file system without it: two steps, the old bundle stays beside if we die between
        aside = new.with_suffix(".old")
        path.rename(aside)
        try:
            new.rename(path)
        except OSError:
            aside.rename(path)
            raise
        aside.rename(new)


def _manifest(path: Path) -> dict[str, Any]:
    """The manifest of a bundle, itself intact.

    Raises:
        BundleError: see `load`.
    """
    file = shown(path / MANIFEST)
    if not path.is_dir():
        what = "is not a bundle, which is a folder" if path.exists() else "does not exist"
        raise BundleError(f"{shown(path)}: {what}; give a folder written by `lava-vpr deploy`")
    try:
        manifest = _strict_json(read_bytes(path / MANIFEST, "bundle_json_bytes"))
    except FileNotFoundError:
        raise BundleError(
            f"{shown(path)}: holds no {MANIFEST}, so it is no bundle; give a model file, which `lava-vpr train` makes "
            "of a folder of images, or a folder written by `lava-vpr deploy`"
        ) from None
    except OSError as error:
        raise BundleError(f"{file}: cannot be read ({error.strerror}); check it and its permissions") from None
    except ValueError as error:
        raise BundleError(f"{file}: is no JSON ({error}); {AGAIN}") from None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise BundleError(f"{file}: is not a bundle's manifest; give a folder written by `lava-vpr deploy`")
    version, target = manifest.get("version"), manifest.get("target")
    if not whole(version) or version != VERSION:
        raise BundleError(
            f"{file}: is of version {brief(version)}, this program reads {VERSION}; deploy the model again"
        )
    try:
        own = self_digest(manifest)
    except (ValueError, RecursionError):  # a number beyond all floats; deeper than can be written
        own = ""
    if not own or manifest.get("sha256") != own:
        raise BundleError(f"{file}: was altered (checksum differs); {AGAIN}")
    if not isinstance(target, str) or target not in BOARDS:
        raise BundleError(f"{file}: is for the unknown board {brief(target)}; {AGAIN}")
    _check_listed(manifest.get("files"), file)
    return manifest


def _check_listed(listed: object, file: str) -> None:
    """Refuse a list of files that is none, is beyond the limits, or leads out of the bundle.

    Args:
        listed: What the manifest says: length and SHA-256 of each file by its name; names differ by more than case.
        file: The manifest, for messages.
    Raises:
        BundleError: naming what is wrong.
    """
    if not isinstance(listed, dict):
        raise BundleError(f"{file}: lists {brief(listed)} instead of its files; {AGAIN}")
    beyond, seen, length = excess("bundle_files", len(listed)), {MANIFEST}, 0
    for name, facts in listed.items() if beyond is None else ():
        if not _NAME.fullmatch(name) or name.lower() in seen:
            raise BundleError(f"{file}: names {brief(name)}, which is not in the bundle; {AGAIN}")
        known = isinstance(facts, dict) and set(facts) == {"bytes", "sha256"}
        if not known or not whole(facts["bytes"]) or facts["bytes"] < 0:
            raise BundleError(f"{file}: says {brief(facts)} of {name}, not its bytes and sha256; {AGAIN}")
        seen.add(name.lower())
        length += facts["bytes"]
    beyond = beyond or excess("bundle_bytes", length)
    if beyond is not None:
        raise BundleError(f"{file}: lists {beyond}")


def load(path: Path) -> ReadBundle:
    """The bundle in the folder ``path``, of which every listed file is whole; what they hold is for others to check.

    Files that are not listed are not read.

    Raises:
        BundleError: missing, foreign, of another version, altered, truncated, beyond the limits, or with files missing.
    """
    manifest = _manifest(path)
    files, inside = {}, os.path.realpath(path) + os.sep
    for name, facts in manifest["files"].items():
        at = shown(path / name)
        try:
            if not os.path.realpath(path / name).startswith(inside):
                raise BundleError(f"{at}: is a link that leads out of the bundle; put the file itself there")
            with open_regular(path / name) as file:
                length = os.fstat(file.fileno()).st_size
                data = file.read(length) if length == facts["bytes"] else b""
        except FileNotFoundError:
            raise BundleError(f"{at}: is missing from the bundle; {AGAIN}") from None
        except OSError as error:
            raise BundleError(f"{at}: cannot be read ({error.strerror}); check it and its permissions") from None
        if length != facts["bytes"] or len(data) != length:
            raise BundleError(f"{at}: has {length:,} bytes instead of {facts['bytes']:,}; {AGAIN}")
        if hashlib.sha256(data).hexdigest() != facts["sha256"]:
            raise BundleError(f"{at}: was altered (checksum differs); {AGAIN}")
        files[name] = data
    return ReadBundle(path, manifest, files)
