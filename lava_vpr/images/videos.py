"""Videos, frame by frame; and cameras, as OpenCV opens them: ``camera:0``, ``/dev/video0``, or the address of a stream,
``rtsp://...``.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, shown
from lava_vpr.images.containers import examine
from lava_vpr.images.imagefiles import quiet
from lava_vpr.images.sampling import Sample
from lava_vpr.images.windows import DamagedError, Film
from lava_vpr.storage.limits import within
from lava_vpr.storage.reading import open_regular


@contextlib.contextmanager
def _capture(path: Path) -> Iterator[tuple[cv2.VideoCapture, Film]]:
    """The opened video, released at the end, and its container's properties.

    FFmpeg gets the examined file by its descriptor, so that it cannot take the name for a protocol or a pattern. Its
    format is prescribed, and the only protocol allowed is that of files.
    """
    try:
        with open_regular(path) as file:
            film = _examined(path, file.fileno())
            options = f"protocol_whitelist;file|format_whitelist;{film.demuxer}|input_format;{film.demuxer}"
            with quiet(), _told_to_ffmpeg(options):
                capture = cv2.VideoCapture(f"/dev/fd/{file.fileno()}", cv2.CAP_FFMPEG)
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror}); check path and permissions") from None
    try:
        if not capture.isOpened():
            raise InputError(f"{shown(path)}: cannot be decoded as a video; convert it to MP4 (H.264) or to images")
        _check_size(path, int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        yield capture, film
    finally:
        capture.release()


@contextlib.contextmanager
def _told_to_ffmpeg(options: str) -> Iterator[None]:
    """FFmpeg's options while it opens a video; it prints no damage on standard error, unless a variable asks for it.

    Afterwards the environment is as it was: commands try OpenCV in a child where they find variables of it.
    """
    level, given = names = ("OPENCV_FFMPEG_LOGLEVEL", "OPENCV_FFMPEG_CAPTURE_OPTIONS")
    before = {name: os.environ[name] for name in names if name in os.environ}
    os.environ.update({level: "-8", **before, given: options})
    try:
        yield
    finally:
        for name in names:
            del os.environ[name]
        os.environ.update(before)


def _examined(path: Path, handle: int) -> Film:
    """The properties of a video, once its structure is found complete and its frames are within the limit."""
    try:
        film = examine(handle)
    except DamagedError as error:
        raise InputError(
            f"{shown(path)}: is damaged or cut short ({error}); copy it again, or if it plays to its end, convert the "
            "video to MP4 (H.264) or to images"
        ) from None
    except InputError as error:
        raise InputError(f"{shown(path)}: {error}") from None
    for width, height in film.sizes:
        _check_size(path, width, height)
    return film


def _check_size(path: Path, width: int, height: int) -> None:
    """Refuse frames that are larger than images may be."""
    within("image_pixels", width * height, f"{shown(path)}: has frames of {width} x {height},")


def video_samples(path: Path) -> Iterator[Sample]:
    """Every frame of a video, uint8 (h, w, 3) BGR; its stamp is in seconds since the first frame.

    Frames that are not read are decoded, too, since headers are often wrong about their number and times.

    Raises:
        InputError: no video of a known format, damaged or cut short, or its last frames cannot be decoded.
    """
    number, time, first = 0, 0.0, 0.0
    with _capture(path) as (capture, film):
        rate = capture.get(cv2.CAP_PROP_FPS)
        period = 1 / rate if rate > 0 else 0.04
        while capture.grab():
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            first = stamp if number == 0 else first
            # A frame without a time of its own (some containers give 0 for the last) follows after one period.
            time = stamp - first if number == 0 or stamp - first > time else time + period
            fault = f"{shown(path)}: frame {number} cannot be decoded; was the file changed?"
            yield Sample(number, time, partial(_retrieved, capture, fault), time)
            number += 1
        missing, cause = (film.span - time) / period, ""
        if number and (missing > 1.5 or (missing > 0.5 and number < film.frames)):
            cause = f"{time:.2f} of {film.span:.2f} seconds can be decoded"
        elif 0 < number < film.least:
            cause = f"{number:,} of {film.least:,} frames can be decoded"
        if cause:
            raise InputError(f"{shown(path)}: is damaged or cut short ({cause}); copy it again or convert it")
    if not number:
        raise InputError(f"{shown(path)}: holds no video frame that can be decoded; convert it to MP4 (H.264)")


def _retrieved(capture: cv2.VideoCapture, fault: str) -> NDArray[np.uint8]:
    """The image grabbed last; raises an `InputError` with the text ``fault`` if there is none."""
    good, image = capture.retrieve()
    if not good or image is None:
        raise InputError(fault)
    return np.asarray(image, np.uint8)


CAMERA = re.compile(r"(?:camera:|/dev/video)(\d{1,3})|rtsps?://.*", re.DOTALL)
"""The name of a camera: its number (group 1), or an RTSP address."""
_WAIT_MS = 5000
"""Time-out of a stream that does not answer, in milliseconds."""


def camera_samples(source: str) -> Iterator[Sample]:
    """The images of a camera, uint8 (h, w, 3) BGR, until it stops delivering.

    Stamps are the times of arrival, in seconds since 1970.

    Args:
        source: Its name (`CAMERA`).
    Raises:
        InputError: there is no such camera, or it gives no (further) image.
    """
    name = shown(re.sub(r"//[^/@]*@", "//***@", source))  # without a password
    fault = f"{name}: gives an image that cannot be decoded; check its cable or connection"
    capture = _opened(source, name)
    number, first = 0, 0.0
    try:
        while capture.grab():
            now = time.time()
            first = now if number == 0 else first
            yield Sample(number, now, partial(_retrieved, capture, fault), now - first)
            number += 1
    finally:
        capture.release()
    raise InputError(
        f"{name}: gives {'no further image' if number else 'no image'}; check its cable or connection, and that no "
        "other program uses it"
    )


def _opened(source: str, name: str) -> cv2.VideoCapture:
    """The opened camera; messages of codecs are suppressed."""
    device = CAMERA.fullmatch(source)
    if device is not None and device[1]:
        path = f"/dev/video{int(device[1])}"
        if not os.path.exists(path):
            raise InputError(f"{name}: there is no camera {path}; plug it in, or see which there are: ls /dev/video*")
        with quiet():
            capture = cv2.VideoCapture(int(device[1]), cv2.CAP_V4L2)
            capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # no outdated image
    else:
        with quiet(), _told_to_ffmpeg("rtsp_transport;tcp"):
            waits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _WAIT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _WAIT_MS]
            capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, waits)
    if not capture.isOpened():
        capture.release()
        raise InputError(f"{name}: cannot be opened; check its address, permissions (group video) and other programs")
    return capture
