"""The golden files: all that commands and calls give, compared with the committed record, byte for byte.

    python scripts/golden.py compare              run all cases, and compare with tests/golden/record.json
    python scripts/golden.py compare DIR          compare a capture with the record
    python scripts/golden.py compare DIR1 DIR2    compare two captures, and show where files differ first
    python scripts/golden.py capture DIR          run all cases, and keep all that they give
    python scripts/golden.py record               run all cases, and write the record again
    python scripts/golden.py list                 the cases

Cases that want real images (LAVA_VPR_DATA) or AVX-512 are left out without, and counted.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from golden import record, running
from golden.comparing import differing, one_line
from golden.table import IMAGES, PROCESSOR, Case, cases


def main(words: Sequence[str]) -> int:
    """Run a command of the above; 0 if nothing differs, 1 if something does."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("do", choices=["compare", "capture", "record", "list"])
    parser.add_argument("folders", nargs="*", type=Path, metavar="DIR")
    parser.add_argument(
        "--only",
        metavar="PATTERN",
        action="append",
        default=[],
        help="cases of such keys, as 'help/*'; repeat it for several",
    )
    parser.add_argument("--jobs", type=int, default=2, help="cases at a time (default: 2)")
    parser.add_argument("--apart", action="store_true", help="run each command in a process of its own")
    asked = parser.parse_args(words)
    asked.folders = [folder.absolute() for folder in asked.folders]
    most = {"compare": 2, "capture": 1}.get(asked.do, 0)
    if len(asked.folders) > most or (asked.do == "capture" and not asked.folders):
        parser.error(f"{asked.do} takes {'one folder' if asked.do == 'capture' else f'at most {most} folders'}")
    patterns = asked.only or ["*"]
    chosen = [case for case in cases() if any(fnmatch(case.key, pattern) for pattern in patterns)]
    if asked.do == "list":
        print("\n".join(f"{case.key:32} {one_line(case.command)}" for case in chosen))
        print(f"{len(chosen)} cases")
        return 0
    if len(asked.folders) == 2:
        old, new = map(record.record_of, asked.folders)
        return _told(list(differing(old, new, asked.folders)), len(new))
    if asked.folders and asked.do == "compare":
        return _compared(asked.folders[0])
    with tempfile.TemporaryDirectory(prefix="captured-") as temporary:
        out = (asked.folders or [Path(temporary)])[0]
        if out.exists() and any(out.iterdir()):
            parser.error(f"{out} is not empty")
        left_out = _captured(chosen, out, asked)
        if asked.do == "compare":
            return _compared(out)
        if asked.do == "record":
            if left_out:
                sys.exit("the record has all cases: it is written where none is left out")
            old = record.read() if asked.only else {}
            record.write(old | record.record_of(out))
    return 0


def _captured(chosen: list[Case], out: Path, asked: argparse.Namespace) -> int:
    """Run cases into ``out``; returns how many are left out for want of images."""
    began, data = time.monotonic(), running.ready()
    lacking = {IMAGES} if data is None else set()
    if not np.core._multiarray_umath.__cpu_features__["AVX512_SKX"]:
        lacking.add(PROCESSOR)
    able = [case for case in chosen if not case.wants & lacking]
    running.run_all(able, out, asked.jobs, data, asked.apart, _progress)
    _progress("")
    print(f"{len(running.with_needs(able))} cases in {time.monotonic() - began:.0f} s", file=sys.stderr)
    for want in lacking:
        print(f"{sum(want in case.wants for case in chosen)} cases are left out, which want {want}", file=sys.stderr)
    return len(chosen) - len(able)


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\x1b[2K{text}", end="", file=sys.stderr, flush=True)


def _compared(captured: Path) -> int:
    """Compare a capture with the committed record, as far as both go."""
    if sys.version_info[:2] != (3, 10):
        print("note: the record is one of Python 3.10 with Lava; elsewhere texts may differ", file=sys.stderr)
    new = record.record_of(captured)
    return _told(list(differing({key: one for key, one in record.read().items() if key in new}, new)), len(new))


def _told(lines: list[str], count: int) -> int:
    print("\n".join(lines or [f"{count} cases are equal"]))
    return int(bool(lines) or not count)
