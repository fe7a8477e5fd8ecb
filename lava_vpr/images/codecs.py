"""Silence around native code: what codecs print on standard error is caught, so that the user sees our line alone."""

from __future__ import annotations

import contextlib
import io
import os
import re
import tempfile
import threading
from collections.abc import Iterator
from typing import IO

import cv2

_lock = threading.Lock()
# What libpng, libjpeg and ffmpeg print; anything else that was caught belongs to another thread and is passed on.
_CODEC_LINE = re.compile(
    rb"libpng |Corrupt JPEG|Premature end|Inconsistent progression|Invalid SOS|Unknown Adobe|Warning: unknown JFIF"
    rb"|Unsupported marker|TIFF|\[\w[^]]* @ 0x|OpenCV"
)


def _memory_file() -> io.FileIO | IO[bytes]:
    """An empty file without a name; in memory where the system can, since one is made for every image."""
    if hasattr(os, "memfd_create"):
        return io.FileIO(os.memfd_create("codec messages"), "r+")
    return tempfile.TemporaryFile(buffering=0)


@contextlib.contextmanager
def quiet() -> Iterator[list[bytes]]:
    """Catch what native code prints on standard error; the list is filled with its codec messages at the end."""
    messages: list[bytes] = []
    with _lock, _memory_file() as caught:
        level = cv2.getLogLevel()
        try:
            saved = os.dup(2)
        except OSError:  # standard error is closed: nothing to keep quiet
            yield messages
            return
        cv2.setLogLevel(0)
        os.dup2(caught.fileno(), 2)
        try:
            yield messages
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            cv2.setLogLevel(level)
            caught.seek(0)
            lines = (caught.read() or b"").splitlines(keepends=True)
            messages.extend(line for line in lines if _CODEC_LINE.match(line))
            for line in lines:
                if not _CODEC_LINE.match(line):
                    os.write(2, line)
