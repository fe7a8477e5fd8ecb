"""Cameras, as OpenCV opens them: ``camera:0``, ``/dev/video0``, or the address of a stream, ``rtsp://...``."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.images.codecs import quiet
from lava_vpr.images.sampling import Sample
from lava_vpr.storage.text import shown

_DEVICE = re.compile(r"(?:camera:|/dev/video)(\d{1,3})")
_STREAM = re.compile(r"rtsps?://")
_WAIT_MS = 5000
"""Milliseconds after which a stream that does not answer is given up."""


def is_camera(source: str) -> bool:
    """Whether ``source`` names a camera."""
    return _DEVICE.fullmatch(source) is not None or _STREAM.match(source) is not None


def camera_samples(source: str) -> Iterator[Sample]:
    """The images of a camera, uint8 (h, w, 3) BGR, as long as it gives any.

    Their stamps are when they came, in seconds since 1970.

    Args:
        source: Its name (`is_camera`).
    Raises:
        InputError: there is no such camera, or it gives no (further) image.
    """
    name = shown(re.sub(r"//[^/@]*@", "//***@", source))  # without a password
    capture = _opened(source, name)
    number, first = 0, 0.0
    try:
        while capture.grab():
            now = time.time()
            first = now if number == 0 else first
            yield Sample(number, now, partial(_image, name, capture), now - first)
            number += 1
    finally:
        capture.release()
    raise InputError(
        f"{name}: gives {'no further image' if number else 'no image'}; check its cable or connection, and that no "
        "other program uses it"
    )


def _image(name: str, capture: cv2.VideoCapture) -> NDArray[np.uint8]:
    """The image that was the last to be grabbed."""
    good, image = capture.retrieve()
    if not good or image is None:
        raise InputError(f"{name}: gives an image that cannot be decoded; check its cable or connection")
    return np.asarray(image, np.uint8)


def _opened(source: str, name: str) -> cv2.VideoCapture:
    """The opened camera; what codecs say of it is kept quiet."""
    device = _DEVICE.fullmatch(source)
    if device is not None:
        path = f"/dev/video{int(device[1])}"
        if not os.path.exists(path):
            raise InputError(f"{name}: there is no camera {path}; plug it in, or see which there are: ls /dev/video*")
        with quiet():
            capture = cv2.VideoCapture(int(device[1]), cv2.CAP_V4L2)
            capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # no image of long ago
    else:
        with quiet():
            os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
            os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = "rtsp_transport;tcp"
            waits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _WAIT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _WAIT_MS]
            capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, waits)
    if not capture.isOpened():
        capture.release()
        raise InputError(f"{name}: cannot be opened; check its address, permissions (group video) and other programs")
    return capture
