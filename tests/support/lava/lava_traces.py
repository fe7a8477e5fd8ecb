"""What runs of Lava leave on this machine: processes, shared memory, folders.

Used by isolated.
"""

from __future__ import annotations

import os
from pathlib import Path

SHARED = Path("/dev/shm")


class Place:
    """A folder for temporary files, and what the runs that use it leave anywhere."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.sessions: set[int] = set()
        self.names: set[str] = set()

    def processes(self) -> dict[int, int]:
        """Processes that a run in this place started, and their sessions; also once their command lines are gone."""
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                command = (folder / "cmdline").read_bytes()
                state, _, _, session = (folder / "stat").read_text().rpartition(")")[2].split()[:4]
            except OSError:
                continue
            if state not in "ZX" and (
                str(self.root).encode() + b"/lava-vpr-" in command or int(session) in self.sessions
            ):
                found[int(folder.name)] = int(session)
        return found

    def note(self) -> None:
        """Remember what is there now: a run is on."""
        self.sessions |= set(self.processes().values())
        self.names |= {path.name for path in self.root.glob("lava-vpr-????????")}
        assert self.sessions
        assert self.names

    def go_on(self) -> None:
        """Remember what is there now, then let it end."""
        self.note()
        for name in self.names:
            (self.root / name / "go").touch()

    def shared(self) -> list[str]:
        """Shared memory and semaphores that the runs noted here made."""
        return [name for name in os.listdir(SHARED) if any(own in name for own in self.names)]

    def left(self) -> list[str]:
        """What is left of the runs."""
        folders = [path.name for path in self.root.glob("lava-vpr-*") if path.suffix != ".txt"]
        return [*map(str, self.processes()), *self.shared(), *folders]

    def process(self, title: str) -> int:
        """The process that runs ``title``: a model, "the target", or "the keeper" of them all."""
        if title == "the keeper":
            (session,) = set(self.processes().values())
            return session
        for path in self.root.glob("*/stacks-*"):
            if path.read_text().rstrip().endswith(title):
                return int(path.name.removeprefix("stacks-"))
        raise AssertionError(f"{title} does not run")
