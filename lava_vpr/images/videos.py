"""Videos: which frames are used, and these frames as uint8 arrays."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.images.codecs import quiet
from lava_vpr.storage.text import shown

_TIMESTAMP_SLACK_S = 1e-3  # containers round times to milliseconds


@contextlib.contextmanager
def _capture(path: Path) -> Iterator[cv2.VideoCapture]:
    """The opened video, released at the end."""
    # ffmpeg reads this once, at the first video; it prints damage on standard error otherwise.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    with quiet():
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        if not capture.isOpened():
            raise InputError(f"{shown(path)}: cannot be decoded as a video; convert it to MP4 (H.264) or to images")
        yield capture
    finally:
        capture.release()


def sample_video(path: Path, every: float, stop: int | None = None) -> NDArray[np.int64]:
    """Which frames of a video to use: the first one at or after each multiple of ``every`` seconds, each once.

    All frames are decoded to find out, since headers are often wrong about their number and times; ``stop`` ends the
    search after that many samples.

    Returns:
        Frame numbers, int64 (n,), increasing from 0.
    """
    frames: list[int] = []
    due, number, time, first = 0, 0, 0.0, 0.0
    with _capture(path) as capture:
        rate = capture.get(cv2.CAP_PROP_FPS)
        period = 1 / rate if rate > 0 else 0.04
        while capture.grab():
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            first = stamp if number == 0 else first
            # A frame without a time of its own (some containers give 0 for the last) follows after one period.
            time = stamp - first if number == 0 or stamp - first > time else time + period
            if time >= due * every - _TIMESTAMP_SLACK_S:
                frames.append(number)
                if len(frames) == stop:
                    break
                due = int((time + _TIMESTAMP_SLACK_S) // every) + 1
            number += 1
    if not frames:
        raise InputError(f"{shown(path)}: holds no video frame that can be decoded; convert it to MP4 (H.264)")
    return np.array(frames, dtype=np.int64)


def video_frames(path: Path, numbers: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
    """The frames of these numbers, uint8 (h, w, 3) BGR: one pass if they increase, a new pass at each step back."""
    k = 0
    while k < len(numbers):
        at = -1
        with _capture(path) as capture:
            while k < len(numbers) and numbers[k] > at:
                while at < numbers[k] and capture.grab():
                    at += 1
                good, image = capture.retrieve() if at == numbers[k] else (False, None)
                if not good or image is None:
                    raise InputError(f"{shown(path)}: frame {numbers[k]} cannot be decoded; was the file changed?")
                k += 1
                yield image
