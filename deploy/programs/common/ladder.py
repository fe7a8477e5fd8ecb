"""Climbs the ladder of self-tests and writes one file about it, to send back."""

import os
import platform
from typing import Callable, Dict, List

import numpy as np

from refusals import Refused
from result_files import put
from rungs import Rung, expected

Ask = Callable[[Rung], np.ndarray]  # presents a rung's network; the counts, (presentations, neurons)


def climb(rungs: List[Rung], ask: Ask, shape: tuple, references: Dict[str, Callable[[], str]], about: dict) -> dict:
    """Ask for every rung, whatever becomes of the others, and say what was found.

    Args:
        rungs: The small networks.
        ask: Presents one.
        shape: Steps with input and silent ones of a presentation.
        references: What is asked of the bundle's own network, by name: text, or Refused.
        about: What else the file says: board, bundle, versions.
    """
    found: List[dict] = []
    for rung in rungs:
        wanted = expected(rung, *shape)
        row: dict = {"name": rung.name, "proves": rung.proves, "expected": [wanted] * rung.presentations}
        try:
            row["found"] = np.asarray(ask(rung)).tolist()
            row["passed"] = row["found"] == row["expected"]
        except Refused as error:
            row.update(passed=False, found=None, error=str(error))
        found.append(row if row["passed"] else dict(row, failure=rung.failure))
        say(found[-1])
    for name, present in references.items():
        row = {"name": name, "proves": "the whole network of the bundle counts as the host does"}
        try:
            row.update(said=present(), passed=True)
        except Refused as error:
            row.update(said=str(error), passed=False, failure="see the first rung that failed; if none, size matters")
        found.append(row)
        say(row)
    versions = {"python": platform.python_version(), "numpy": np.__version__, "machine": platform.platform()}
    return {"passed": all(row["passed"] for row in found), "rungs": found, "versions": versions, **about}


def say(row: dict) -> None:
    """A line about a rung."""
    if row["passed"]:
        text = "ok      {}: {}".format(row["name"], row.get("said") or row["proves"])
    else:
        why = row.get("error") or row.get("said") or "counts {} instead of {}".format(row["found"], row["expected"])
        text = "FAILED  {}: {}; {}".format(row["name"], why, row["failure"])
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
    failed = [row["name"] for row in report["rungs"] if not row["passed"]]
    if failed:
        raise Refused(
            "result",
            "{} of {} rungs failed, first {}; send {}".format(len(failed), len(report["rungs"]), failed[0], path),
        )
    return "all {} rungs hold; send {}".format(len(report["rungs"]), path)
