"""Reads the folder of a bundle: every file is as the manifest's checksums say, or the bundle is refused.

This needs nothing but Python.
"""

import hashlib
import io
import json
import os
from typing import Any

from refusals import Refused

MANIFEST, FORMAT, VERSION = "manifest.json", "lava-vpr bundle", 1
AGAIN = "deploy the model again or fetch an intact copy"


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def read(folder: str, name: str) -> bytes:
    """Content of a file of the bundle.

    Raises:
        Refused: it cannot be read.
    """
    path = os.path.join(folder, *name.split("/"))
    try:
        if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):  # a pipe would be waited for
            raise OSError(22, "is no file")
        with open(path, "rb") as file:
            return file.read()
    except (OSError, ValueError) as error:  # the latter of a name that no file can have
        raise bad(folder, name, "cannot be read (" + str(getattr(error, "strerror", error)) + ")") from None


def bad(folder: str, name: str, what: str) -> Refused:
    """What to raise about a file of the bundle."""
    return Refused("bundle", os.path.join(folder, name) + ": " + what + "; " + AGAIN)


def read_manifest(folder: str) -> dict:
    """The manifest, which has files, sha256, format, version, target and network.

    Raises:
        Refused: missing, altered or something else.
    """
    try:
        manifest = dict(json.loads(read(folder, MANIFEST).decode()))
        rest = {key: value for key, value in manifest.items() if key != "sha256"}
        own = digest(json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False).encode())
        sealed = manifest["sha256"]
        [manifest[key] for key in ("format", "version", "target", "network")]
        [(facts["bytes"], facts["sha256"]) for facts in manifest["files"].values()]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise bad(folder, MANIFEST, "is not a bundle's manifest") from None
    if own != sealed:
        raise bad(folder, MANIFEST, "was altered (checksum differs)")
    return manifest


def read_files(folder: str, manifest: dict) -> dict:
    """Content of every file that the manifest lists.

    Raises:
        Refused: missing or altered.
    """
    files = {}
    for name, facts in sorted(manifest["files"].items()):
        files[name] = read(folder, name)
        if (len(files[name]), digest(files[name])) != (facts["bytes"], facts["sha256"]):
            raise bad(folder, name, "was altered (checksum differs)")
    return files


def array_of(data: bytes) -> Any:
    """The array in the content of a ``.npy`` file.

    Raises:
        ValueError: there is none.
    """
    import numpy as np  # only here: files are checked without it

    try:
        return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))
    except Exception as error:  # numpy parses headers as Python
        raise ValueError(str(error)) from None


class Bundle:
    """The files around a host program, every one as its checksum says.

    Raises:
        Refused: missing, altered or for another board.
    """

    def __init__(self, folder: str, target: str) -> None:
        self.folder, self.manifest = folder, read_manifest(folder)
        self.files = read_files(folder, self.manifest)
        kind = [self.manifest[key] for key in ("format", "version", "target")]
        if kind != [FORMAT, VERSION, target]:
            wanted = "is {} {} for {}, not {} {} for {}".format(*kind, FORMAT, VERSION, target)
            raise bad(folder, MANIFEST, wanted)

    def intact(self) -> str:
        """That all files are as they were written, in words."""
        sizes = sum(len(data) for data in self.files.values())
        return "intact: {} files, {} bytes, all as their checksums say".format(len(self.files), sizes)

    def numbers(self, *names: str) -> list:
        """Numbers of the network, as the manifest has them."""
        try:
            return [int(self.manifest["network"][name]) for name in names]
        except (KeyError, TypeError, ValueError):
            raise bad(self.folder, MANIFEST, "does not describe the network") from None

    @property
    def direct(self) -> bool:
        """Whether neurons of places hear the cells of a front end: pixels are what queries bring."""
        return "rising" in self.manifest["network"]

    def array(self, name: str) -> Any:
        """The array in a file."""
        try:
            return array_of(self.files[name])
        except (KeyError, ValueError):
            raise bad(self.folder, name, "is missing or no array") from None

    def json(self, name: str) -> dict:
        """The value in a file."""
        try:
            return dict(json.loads(self.files[name].decode()))
        except (KeyError, ValueError, TypeError, RecursionError):
            raise bad(self.folder, name, "is missing or no JSON") from None
