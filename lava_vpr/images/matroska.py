"""The structure of Matroska (WebM) files: a walk that checks that all elements are present.

Sources: RFC 9559 and RFC 8794 (EBML).
"""

from __future__ import annotations

from lava_vpr.errors import InputError
from lava_vpr.images.windows import DamagedError, Film, Part, Window

_DOCTYPE, _SEGMENT, _INFO, _TRACKS, _CLUSTER = 0x4282, 0x18538067, 0x1549A966, 0x1654AE6B, 0x1F43B675
_SCALE, _DURATION, _TIMESTAMP, _SIMPLE_BLOCK, _GROUP, _BLOCK = 0x2AD7B1, 0x4489, 0xE7, 0xA3, 0xA0, 0xA1
_TRACK, _NUMBER, _TYPE, _VIDEO, _WIDTH, _HEIGHT = 0xAE, 0xD7, 0x83, 0xE0, 0xB0, 0xBA
_MASTERS = (_INFO, _TRACKS, _TRACK, _VIDEO, _CLUSTER, _GROUP)
_SLACK_S = 1.0  # between the length that a live recording gives for itself and its last block


def _variable(data: bytes, most: int, position: int) -> tuple[int, int]:
    """The number of variable length with which ``data`` begins, its mark included, and its length in bytes.

    Raises:
        DamagedError: it is longer than ``most``, or incomplete; ``position`` is where it begins.
    """
    length = 9 - data[0].bit_length() if data else 9
    if length > min(most, len(data)):
        raise DamagedError(f"no part begins at byte {position:,}, where one should")
    return int.from_bytes(data[:length], "big"), length


def _element(file: Window, position: int, end: int) -> Part:
    """The element at ``position``; one of unknown length counts as empty: its contents follow."""
    head = file.at(position, min(12, file.size - position))
    number, first = _variable(head, 4, position)
    size, second = _variable(head[first:], 8, position)
    start, size = position + first + second, size - (1 << 7 * second)
    if size < (1 << 7 * second) - 1:
        return number, start, start + size
    if number not in (_SEGMENT, _CLUSTER):
        raise DamagedError("a part within another has no length")
    return number, start, start


class _Recording:
    """Properties collected from the elements of a Matroska file; times are in ticks."""

    def __init__(self, file: Window) -> None:
        self.file = file
        self.scale = 1_000_000  # nanoseconds of a tick
        self.duration = 0.0
        self.tracks: list[dict[int, int]] = []  # number, type, width and height, by their elements
        self.cluster = 0  # time stamp of the cluster
        self.blocks: dict[int, tuple[int, int, int]] = {}  # by the track's number: how many, first and last time

    def note(self, number: int, start: int, end: int) -> None:
        """Record the value of an element."""
        if number == _DURATION and end - start in (4, 8):
            self.duration = self.file.numbers(">f" if end - start == 4 else ">d", start)[0]
        elif number == _TRACK:
            self.tracks.append({})
        elif number in (_SIMPLE_BLOCK, _BLOCK):
            self.block(start)
        elif number in (_SCALE, _TIMESTAMP) or (number in (_NUMBER, _TYPE, _WIDTH, _HEIGHT) and self.tracks):
            value = int.from_bytes(self.file.at(start, min(8, end - start)), "big")
            if number == _SCALE:
                self.scale = value
            elif number == _TIMESTAMP:
                self.cluster = value
            else:
                self.tracks[-1][number] = value

    def block(self, start: int) -> None:
        """Record the time of a block."""
        head = self.file.at(start, min(10, self.file.size - start))
        track, length = _variable(head, 8, start)
        time = self.cluster + self.file.numbers(">h", start + length)[0]
        count, first, last = self.blocks.get(track - (1 << 7 * length), (0, time, time))
        self.blocks[track - (1 << 7 * length)] = count + 1, min(first, time), max(last, time)

    def film(self, live: bool) -> Film:
        """Properties of the file; a ``live`` recording must be as long as its header says, if it gives a length."""
        declared = self.duration * self.scale / 1e9
        seconds = max((last for _, _, last in self.blocks.values()), default=0) * self.scale / 1e9
        if live and declared > seconds + _SLACK_S:
            raise DamagedError(f"it holds {seconds:.1f} of {declared:.1f} seconds")
        films = [track for track in self.tracks if track.get(_TYPE) == 1]
        count, first, last = self.blocks.get(films[0].get(_NUMBER, -1) if films else -1, (0, 0, 0))
        sizes = tuple((track.get(_WIDTH, 0), track.get(_HEIGHT, 0)) for track in films)
        return Film("matroska,webm", sizes, count, (last - first) * self.scale / 1e9)


def walk_matroska(file: Window) -> Film:
    """Properties of a Matroska or WebM file, which must be complete.

    Raises:
        DamagedError: part of it is missing.
        InputError: it is of another type.
    """
    _, start, end = _element(file, 0, file.size)
    kinds = [file.at(s, min(8, e - s)) for n, s, e in file.walk(start, file.reach(end), _element) if n == _DOCTYPE]
    if kinds[:1] not in ([b"matroska"], [b"webm"]):
        raise InputError("is no Matroska or WebM video, though it begins like one; convert it to MP4 (H.264)")
    number, start, stop = _element(file, end, file.size)
    if number != _SEGMENT:
        raise DamagedError(f"no segment begins at byte {end:,}")
    live, recording = stop == start, _Recording(file)
    for part in file.walk(start, file.reach(file.size if live else stop), _element, _MASTERS):
        recording.note(*part)
    return recording.film(live)
