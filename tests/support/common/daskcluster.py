"""A Dask cluster on the loopback address, scheduler and workers as processes; functions that workers can import.

Used by bench, cli, cluster, paper_table, studies and training.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

from support.common import children

from lava_vpr.errors import ConfigError

TESTS = Path(__file__).resolve().parents[2]
DEADLINE = 120.0  # seconds; reached only when something hangs
QUIET = ("--no-dashboard", "--host", "127.0.0.1")


def made_keys(folder: Path) -> dict[str, str]:
    """A key and a certificate that signs itself, in ``folder``; the environment variables of who uses them."""
    subject = ("-subj", "/CN=lava-vpr", "-addext", "subjectAltName=IP:127.0.0.1", "-days", "2")
    files = ("-keyout", folder / "key.pem", "-out", folder / "cert.pem")
    children.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", *subject, *files], check=True)
    comm = "DASK_DISTRIBUTED__COMM__TLS__"
    return {
        f"{comm}CA_FILE": str(folder / "cert.pem"),
        f"{comm}CLIENT__CERT": str(folder / "cert.pem"),
        f"{comm}CLIENT__KEY": str(folder / "key.pem"),
    }


class DaskCluster(AbstractContextManager["DaskCluster"]):
    """A scheduler, and workers of one thread each that come, go and are killed."""

    def __init__(self, folder: Path, workers: int = 2, allowed_failures: int = 3, keys: Path | None = None) -> None:
        """Start it, with its logs in ``folder``; ``keys``: a folder with the files of `made_keys`, for TLS."""
        self.folder = folder
        cert, key = f"{keys}/cert.pem", f"{keys}/key.pem"
        tls = ("--protocol", "tls", "--tls-ca-file", cert, "--tls-cert", cert, "--tls-key", key)
        self._said = QUIET if keys is None else (*QUIET, *tls)
        self._failures = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(allowed_failures)}
        self.processes: list[children.Child] = []
        file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--port", "0", *self._said, "--scheduler-file", str(file))
        self.address = str(self._until(lambda: json.loads(file.read_text()))["address"])
        self.workers = [self.add() for _ in range(workers)]
        self._until(lambda: self.logs().count("Registered to:") >= workers)

    def _start(self, *words: str, program: str | None = None) -> children.Child:
        """``dask`` with these words; ``program`` is Python that comes before."""
        start = f"{program or ''}\nfrom dask.__main__ import main; main()"
        folders = os.pathsep.join((str(TESTS), str(TESTS.parent)))
        environment = {**os.environ, "PYTHONPATH": folders, "PYTHONWARNINGS": "ignore", **self._failures}
        log = (self.folder / f"{len(self.processes)}.log").open("wb")
        with log:
            command = [sys.executable, "-c", start, *words]
            process = children.Child(command, stdout=log, stderr=log, env=environment, cwd=self.folder)
        self.processes.append(process)
        return process

    def _until(self, found: Callable[[], Any]) -> Any:
        """What ``found`` gives once it is there, and whole."""
        end = time.monotonic() + DEADLINE
        while time.monotonic() < end:
            with suppress(OSError, ValueError):
                result = found()
                if result:
                    return result
            assert self.scheduler.poll() is None, self.logs()
            time.sleep(0.02)
        raise AssertionError(f"the cluster does not start: {self.logs()}")

    def add(self, *words: str, program: str | None = None) -> children.Child:
        """Another worker, which a kill ends for good; ``program`` runs in its process before."""
        own = ("--nthreads", "1", "--no-nanny", "--memory-limit", "0", "--local-directory", str(self.folder))
        return self._start("worker", self.address, *own, *self._said, *words, program=program)

    def logs(self) -> str:
        """What all processes have written."""
        return "\n".join(path.read_text(errors="replace") for path in sorted(self.folder.glob("*.log")))

    def __exit__(self, *error: object) -> None:
        """Kill what is left."""
        for process in self.processes:
            process.end()


def times(shared: Any, task: Any) -> Any:
    """The product."""
    return shared * task


def refuse(shared: int, task: int) -> int:
    """The task, or an error of the kind that ``shared`` says, if it is 3."""
    if task == 3:
        raise (ConfigError("3 is too many; give 2") if shared == 0 else ValueError("three\nlines"))
    return task


def rest(shared: tuple[Any, float], task: int) -> int:
    """The task, after some seconds."""
    time.sleep(shared[1])
    return task


def die(shared: object, task: int) -> None:
    """End the worker."""
    os._exit(1)


def die_once(folder: str, task: int) -> int:
    """The task; whoever is first to get task 2 dies of it, and so does the next."""
    for number in range(2) if task == 2 else ():
        try:
            (Path(folder) / f"died-{number}").touch(exist_ok=False)
        except FileExistsError:
            continue
        os._exit(1)
    return task
