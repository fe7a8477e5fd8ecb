"""Reading waits for no pipe and takes no more than a limit allows; JSON breaks no reader."""

from __future__ import annotations

import os
import tracemalloc
from pathlib import Path

import pytest

from lava_vpr.errors import ConfigError
from lava_vpr.storage.limits import LIMITS, excess, limit, variable
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.text import harmless, shown


def test_reading_takes_what_the_file_holds_not_what_the_limit_allows(tmp_path: Path) -> None:
    """As long as they are read, bytes stand in memory twice at most; the limit on models is a gibibyte."""
    (tmp_path / "a").write_bytes(bytes(10_000))
    tracemalloc.start()
    try:
        assert len(read_bytes(tmp_path / "a", "text_bytes")) == 10_000
        assert tracemalloc.get_traced_memory()[1] < 200_000
    finally:
        tracemalloc.stop()


def test_a_file_that_tells_no_length_is_read_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Linux says 0 for its own tables."""
    assert Path("/proc/self/mountinfo").stat().st_size == 0
    assert read_bytes(Path("/proc/self/mountinfo"), "text_bytes").count(b"\n") > 1
    monkeypatch.setenv("LAVA_VPR_MAX_TEXT_BYTES", "10")
    with pytest.raises(OSError, match="has 11 bytes, more than the 10 allowed"):
        read_bytes(Path("/proc/self/mountinfo"), "text_bytes")


@pytest.mark.timeout(20)
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="named pipe"):
        read_bytes(tmp_path / "pipe", "text_bytes")


def test_devices_and_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="device"):
        read_bytes(Path("/dev/zero"), "text_bytes")
    with pytest.raises(IsADirectoryError):
        read_bytes(tmp_path, "text_bytes")
    with pytest.raises(OSError, match="null"):
        read_bytes(tmp_path / "a\0b", "text_bytes")


def test_a_limit_is_named_and_can_be_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_bytes(b"12345678901")
    monkeypatch.setenv("LAVA_VPR_MAX_TEXT_BYTES", "10")
    with pytest.raises(OSError, match=r"has 11 bytes, more than the 10 allowed; .* set LAVA_VPR_MAX_TEXT_BYTES"):
        read_bytes(tmp_path / "a", "text_bytes")
    monkeypatch.setenv("LAVA_VPR_MAX_TEXT_BYTES", "11")
    assert read_bytes(tmp_path / "a", "text_bytes") == b"12345678901"


@pytest.mark.parametrize("text", ["", "0", "-1", "1e9", "many", "9" * 5000])
def test_a_limit_that_is_no_number_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(variable("image_pixels"), text)
    with pytest.raises(ConfigError, match="LAVA_VPR_MAX_IMAGE_PIXELS"):
        limit("image_pixels")


def test_what_is_within_a_limit_is_no_excess() -> None:
    for name, row in LIMITS.items():
        assert excess(name, row.default) is None
        assert variable(name) in str(excess(name, row.default + 1))


@pytest.mark.parametrize("text", ["[" * 100_000, "NaN", "[1, -Infinity]", "1" * 10_000, "{", b"\xff\xfe\xfd", ""])
def test_json_that_is_none_is_a_value_error(text: str | bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_json(text)


def test_text_for_the_terminal_holds_no_control_characters() -> None:
    assert harmless("a\x1b[31mb\x07\u202e\x9bc\nd\te é") == "a\\x1b[31mb\\x07\\u202e\\x9bc\nd\te é"
    assert harmless("plain é ✓") == "plain é ✓"
    assert shown("a\nb") == "'a\\nb'"
    middle = shown("begin/" + "x" * 9000 + "/end")
    assert middle.startswith("begin/xxx")
    assert middle.endswith("xxx/end")
    assert len(middle) < 400
