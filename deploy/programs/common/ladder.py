"""Climbs the ladder of self-tests and writes one file about it, to send back."""

import os
import platform
from typing import Any, Callable, Dict, FrozenSet, Iterable, List, Sequence

import numpy as np

from refusals import Refused
from result_files import put
from ways import OtherWay, tries

Attempt = Callable[[str, FrozenSet[str]], dict]
"""Tries a rung, by its name, in some ways: "found" has counts (presentations, neurons), "said" what was compared,
"error" why there is neither; "output" is what was printed."""
REFERENCES = ("one reference", "all references")


def rows_of(rungs: Sequence[Any], shape: tuple) -> List[dict]:
    """A row for every rung, of which name, proves, failure and counts are asked, and which `climb` fills in; ``shape``:
    steps with input and silent ones of a presentation."""
    rows = []
    for rung in rungs:
        said = {name: getattr(rung, name) for name in ("name", "proves", "failure")}
        rows.append(dict(said, expected=rung.counts(*shape)))
    proves, failure = "the whole network of the bundle counts as the host does", "see the first rung that failed"
    return rows + [
        {"name": name, "proves": proves, "failure": failure + "; if none, size matters"} for name in REFERENCES
    ]


def climb(rows: List[dict], attempt: Attempt, ways: Sequence[OtherWay], taken: FrozenSet[str]) -> dict:
    """Try every rung, whatever becomes of the others, and say what was found.

    A rung that fails is tried in other ways; the first that cures it is kept for all that follow.
    """
    found: List[dict] = []
    for row in rows:
        tried: List[dict] = []
        several = tries(ways, row["name"], taken)
        for more in several:
            result = dict(attempt(row["name"], taken | more), ways=sorted(taken | more))
            result["passed"] = "said" in result or ("found" in result and result["found"] == row["expected"])
            tried.append(result)
            if result["passed"]:
                taken |= more
                break
            if len(several) > 1:
                line = "tried   {}{}: {}".format(row["name"], with_ways(taken | more), reason(row, result))
                print(line, flush=True)
        last = tried[-1] if tried[-1]["passed"] else tried[0]
        done = {"found": None, **row, **last, "tried": [x for x in tried if x is not last]}
        if done["passed"]:
            del done["failure"]
        found.append(done)
        say(done)
    return {"passed": all(row["passed"] for row in found), "ways": sorted(taken), "rungs": found}


def versions() -> Dict[str, str]:
    """Of what every host program runs on."""
    return {"python": platform.python_version(), "numpy": np.__version__, "machine": platform.platform()}


def reason(row: dict, result: dict) -> str:
    """Why an attempt did not pass."""
    return result.get("error") or "counts {} instead of {}".format(result.get("found"), row.get("expected"))


def with_ways(ways: Iterable[str]) -> str:
    """The ways of an attempt, in words; nothing if there are none."""
    return " with " + " and ".join(sorted(ways)) if ways else ""


def say(row: dict) -> None:
    """A line about a rung."""
    ways = with_ways(row.get("ways", ()))
    if row["passed"]:
        text = "ok      {}{}: {}".format(row["name"], ways, row.get("said") or row["proves"])
    else:
        text = "FAILED  {}{}: {}; {}".format(row["name"], ways, reason(row, row), row["failure"])
    print(" ".join(text.split()), flush=True)


def see_to(path: str) -> None:
    """See that the file can be written, before anything else is done.

    Raises:
        Refused: it cannot.
    """
    try:
        with open(path + ".part", "wb"):
            pass
        os.remove(path + ".part")
    except OSError as error:
        raise unwritten(path, error) from None


def unwritten(path: str, error: OSError) -> Refused:
    """What is said of a file that cannot be written."""
    return Refused("input", "{}: cannot be written ({}); name another file".format(path, error.strerror))


def kept(path: str, report: dict) -> str:
    """Write the file; the last line to print.

    Raises:
        Refused: it cannot be written, or a rung failed.
    """
    try:
        put(path, report)
    except OSError as error:
        raise unwritten(path, error) from None
    failed, n = [row["name"] for row in report["rungs"] if not row["passed"]], len(report["rungs"])
    also = "; from now on use --ways " + ",".join(report["ways"]) if report["ways"] else ""
    if failed:
        text = "{} of {} rungs failed, first {}; send {}{}".format(len(failed), n, failed[0], path, also)
        raise Refused("result", text)
    return "all {} rungs hold; send {}{}".format(n, path, also)
