"""Hold what the table of hardware cites against docs/cited_files.csv, and the listed files against their repositories.

python scripts/cited_files.py            say which cited files the list lacks, as an exit code
python scripts/cited_files.py FOLDER     also check header and hash of each listed file that is at hand: in a git
                                         repository FOLDER/OWNER/NAME, FOLDER/OWNER+NAME or FOLDER/NAME, or in an
                                         installed package of the version that the list names

Papers, issues and pull requests are no files: they are cited by DOI or number, and not listed.
"""

from __future__ import annotations

import csv
import hashlib
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple

from lava_vpr.deploy.hardware.table import BELIEFS

LIST = Path(__file__).resolve().parent.parent / "docs" / "cited_files.csv"
FILE = re.compile(r"(?<![\w./-])[\w./-]+\.(?:py|c|h|template|cc|cpp|hpp|ipynb|yaml|json|toml|rst|md|txt|csv|sh)\b")
CLOSED = re.compile("confidential|proprietary|trade secret|disclose", re.IGNORECASE)
"""What the header of a file says that is not to be read."""

HEADER = 60
"""Lines of a header; that of a notebook is its first cell."""


class Cited(NamedTuple):
    """A line of the list: the repository as sources name it and its own name; what was hashed, and how it was seen."""

    source: str
    repository: str
    revision: str
    path: str
    sha256: str
    clean: str
    seen: str


def listed() -> list[Cited]:
    """The lines of the list, in order."""
    with LIST.open(encoding="utf-8", newline="") as file:
        return [Cited(**row) for row in csv.DictReader(file)]


def faults(text: str, files: list[Cited]) -> Iterator[str]:
    """What is wrong with the files that ``text``, a source or why of a row, cites.

    A file is of the repository that was named last before it; its path may leave out folders at the beginning where
    one listed file alone ends so.
    """
    for found in FILE.finditer(text):
        named = {file.source: text.rfind(file.source, 0, found.start()) for file in files}
        source = max(named, key=lambda name: (named[name], len(name)))
        if named[source] < 0:
            yield f"{found[0]}: no listed repository is named before it"
            continue
        own = [file for file in files if file.source == source]
        fit = [file for file in own if file.path == found[0]] or [
            file for file in own if file.path.endswith(f"/{found[0]}")
        ]
        if len(fit) != 1:
            yield f"{source}, {found[0]}: {len(fit)} listed files end so"
        elif fit[0].clean != "yes":
            yield f"{source}, {found[0]}: its header is not clean"


def content(file: Cited, folder: Path) -> bytes | None:
    """The bytes of a listed file, of the very revision; None: it is not at hand."""
    kind, _, rest = file.revision.partition(" ")
    if kind == "PyPI":
        name, _, version = rest.partition(" ")
        try:
            installed = distribution(name)
        except PackageNotFoundError:
            return None
        path = Path(str(installed.locate_file(file.path.removeprefix("src/"))))
        return path.read_bytes() if installed.version == version and path.is_file() else None
    owner, _, name = file.repository.partition("/")
    for at in (folder / owner / name, folder / f"{owner}+{name}", folder / name):
        for git in (at, at / ".git", at / "repo", at / "repo" / ".git"):
            if (git / "objects").is_dir():
                show = ["git", f"--git-dir={git}", "show", f"{file.revision}:{file.path}"]
                done = subprocess.run(show, capture_output=True)
                return done.stdout if done.returncode == 0 else None
    return None


def verdict(file: Cited, data: bytes | None) -> str:
    """What header and hash of a listed file say; ``ok`` where all is as listed."""
    if data is None:
        return "not at hand"
    header = b"\n".join(data.split(b"\n", HEADER)[:HEADER]).decode(errors="replace")
    if CLOSED.search(header):
        return "CLOSED: its header forbids reading"
    return "ok" if hashlib.sha256(data).hexdigest() == file.sha256 else "DIFFERS: another hash"


def main() -> None:
    """Check the citations and, where a folder is given, the files."""
    files = listed()
    rows = BELIEFS.values()
    bad = [f"{row.name}: {fault}" for row in rows for fault in faults(row.source or row.why or "", files)]
    for line in bad:
        print(line)
    if len(sys.argv) > 1:
        verdicts = [verdict(file, content(file, Path(sys.argv[1]))) for file in files]
        for file, said in zip(files, verdicts, strict=True):
            print(f"{said}: {file.repository} {file.revision} {file.path}")
        bad += [said for said in verdicts if said.partition(":")[0].isupper()]
        print(f"{verdicts.count('ok')} of {len(files)} as listed, {verdicts.count('not at hand')} not at hand")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
