"""Reading whole files: regular ones only, and never more than a limit allows; JSON that cannot break its reader."""

from __future__ import annotations

import errno
import json
import os
import stat
from pathlib import Path
from typing import Any, NoReturn

from lava_vpr.storage.limits import excess, limit


def read_bytes(path: Path, limit_name: str) -> bytes:
    """The content of the regular file ``path``.

    Args:
        path: The file; what it is linked to, if it is a link.
        limit_name: The limit in `lava_vpr.storage.limits.LIMITS` on its length in bytes.
    Raises:
        OSError: it is missing, closed to us, longer than the limit, or no regular file (a pipe is not waited for). Its
            ``strerror`` is fit for a message, as in "cannot be read (is a named pipe, not a file)".
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY)
    except ValueError as error:  # a NUL in the name
        raise OSError(errno.EINVAL, str(error), str(path)) from None
    with os.fdopen(handle, "rb") as file:
        status = os.fstat(handle)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(status.st_mode):
            kind = "a named pipe" if stat.S_ISFIFO(status.st_mode) else "a device or socket"
            raise OSError(errno.EINVAL, f"is {kind}, not a file", str(path))
        most = limit(limit_name)
        data = b"" if status.st_size > most else file.read(most + 1)
        beyond = excess(limit_name, max(status.st_size, len(data)))
        if beyond is not None:
            raise OSError(errno.EFBIG, f"has {beyond}", str(path))
        return data


def parse_json(data: bytes | str, **options: Any) -> Any:
    """The value of JSON text; ``options`` go to `json.loads`.

    Raises:
        ValueError: no JSON, not UTF-8, nested too deeply, a number of thousands of digits, NaN or Infinity.
    """
    try:
        return json.loads(data, parse_constant=_refuse_constant, **options)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _refuse_constant(word: str) -> NoReturn:
    raise ValueError(f"{word} is no JSON number")
