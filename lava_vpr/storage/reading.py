"""Reading whole files: regular ones only, and never more than a limit allows; JSON that cannot break its reader."""

from __future__ import annotations

import errno
import json
import os
import stat
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from lava_vpr.storage.limits import excess, limit


def open_regular(path: Path) -> BinaryIO:
    """The regular file ``path`` (or what it is linked to), open for reading.

    Raises:
        OSError: it is missing, closed to us, or no regular file (a pipe is not waited for). Its ``strerror`` is fit for
            a message, as in "cannot be read (is a named pipe, not a file)".
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY)
    except ValueError as error:  # a NUL in the name
        raise OSError(errno.EINVAL, str(error), str(path)) from None
    kind = os.fstat(handle).st_mode
    if stat.S_ISREG(kind):
        return os.fdopen(handle, "rb")
    os.close(handle)
    if stat.S_ISDIR(kind):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    what = "a named pipe" if stat.S_ISFIFO(kind) else "a device or socket"
    raise OSError(errno.EINVAL, f"is {what}, not a file", str(path))


_MOST_DIGITS = 400
"""Digits of a whole number in JSON: those of the largest float, with room."""


def read_bytes(path: Path, limit_name: str) -> bytes:
    """The content of the regular file ``path``.

    Args:
        path: The file; what it is linked to, if it is a link.
        limit_name: The limit in `lava_vpr.storage.limits.LIMITS` on its length in bytes.
    Raises:
        OSError: as `open_regular`, or longer than the limit.
    """
    with open_regular(path) as file:
        length = os.fstat(file.fileno()).st_size
        most = limit(limit_name)
        # Python takes the memory that may be read before it reads: the size the file claims, and one byte.
        data = b"" if length > most else file.read(length + 1)
        if len(data) > length:  # it has grown, or tells no length
            data += file.read(most + 1 - len(data))
        beyond = excess(limit_name, max(length, len(data)))
        if beyond is not None:
            raise OSError(errno.EFBIG, f"has {beyond}", str(path))
        return data


def parse_json(data: bytes | str, **options: Any) -> Any:
    """The value of JSON text, in UTF-8 if it is ``data``; ``options`` go to `json.loads`.

    Raises:
        ValueError: no JSON, another encoding, a byte order mark, nested too deeply, a number of
            thousands of digits, NaN or Infinity.
    """
    try:
        text = data if isinstance(data, str) else data.decode()  # json.loads would guess UTF-16 and UTF-32
        return json.loads(text, parse_constant=_refuse_constant, parse_int=_whole_number, **options)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _whole_number(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise ValueError(f"a number of {len(digits):,} digits is too long")
    return int(digits)


def _refuse_constant(word: str) -> NoReturn:
    raise ValueError(f"{word} is no JSON number")
