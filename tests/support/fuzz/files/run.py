"""Change honest files at random, give them to the program, and count what becomes of them.

    PYTHONPATH=tests .venv/bin/python -m support.fuzz.files.run [--count 10000] [--seed 0] [--first 0] [--show 20]

Prints outcomes by format, and every failure with its seed and number; ``--first NUMBER --count 1`` repeats one alone.
The exit code is 1 if there is a failure. docs/security.md says what is held against what is taken.

Used by storage.
"""

from __future__ import annotations

import argparse
import collections
import json
import sys
import tempfile
import time
from pathlib import Path

import cv2
from support.fuzz.files import cases, corpus, pool
from support.fuzz.files.trial import FAILURES, REFUSED, SOUND


def main() -> int:
    """Run the command; its exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--show", type=int, default=20)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    cv2.setNumThreads(0)  # threads do not survive a fork
    pool.lower_limits()
    started, counts = time.monotonic(), collections.Counter[tuple[str, str]]()
    failures: list[str] = []
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        honest = corpus.make(Path(folder))
        for number, outcome in pool.run(honest, asked.seed, range(asked.first, asked.first + asked.count)):
            case = cases.make(honest, asked.seed, number)
            counts[case.format, outcome.kind] += 1
            if outcome.kind in FAILURES:
                failures.append(f"{outcome.kind}: {case.title}\n    {outcome.told.strip()}")
                if len(failures) <= asked.show:
                    print(failures[-1], flush=True)
    print(_table(counts))
    print(f"{len(failures)} failures of {sum(counts.values())} in {time.monotonic() - started:.0f} s")
    if asked.json is not None:
        told = {f"{format}/{kind}": count for (format, kind), count in sorted(counts.items())}
        asked.json.write_text(json.dumps({"counts": told, "failures": failures}))
    return 1 if failures else 0


def _table(counts: collections.Counter[tuple[str, str]]) -> str:
    """Outcomes by format, as Markdown."""
    kinds = (REFUSED, SOUND, *FAILURES)
    rows = [("format", *kinds, "all")]
    for name in (*cases.SHARES, "all"):
        each = [sum(n for (f, k), n in counts.items() if k == kind and name in (f, "all")) for kind in kinds]
        rows.append((name, *map(str, each), str(sum(each))))
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


if __name__ == "__main__":
    sys.exit(main())
