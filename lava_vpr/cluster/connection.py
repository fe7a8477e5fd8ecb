"""A Dask cluster: its scheduler connected to, its workers compared with us, tasks submitted and those lost run again.

This module alone imports distributed. What crosses between the machines are pickles, so whoever can reach the scheduler
can run programs on all of them: docs/security.md.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import platform
import re
import time
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lava_vpr import __version__
from lava_vpr.cluster.tasks import PATIENCE, LostTaskError, Runner, Told
from lava_vpr.errors import ClusterError, LavaVprError, brief
from lava_vpr.interrupts import stoppable

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_S, WORKERS_S = 10.0, 10.0
"""Seconds in which a scheduler must answer, and the first worker be there."""
ABSENT_S = 60.0
"""Seconds that a run waits while its cluster has no worker at all: who restarts one needs less."""
COUNT_S = 1.0
"""Seconds between two counts of the workers."""
_SEND_S = 1
_GONE = (OSError, RuntimeError, TimeoutError, asyncio.TimeoutError)
"""What distributed raises of a machine that is gone; the last two are one since Python 3.11."""
INSTALL = "pip install 'lava-vpr[cluster]'"


class Connection(Runner):
    """A cluster that was connected to, as a `lava_vpr.cluster.tasks.Pool` takes it.

    Attributes:
        address: Of its scheduler.
        progress: Default progress callback; None: no progress is shown.
        most_absent: Seconds that a run waits while there is no worker.
    """

    def __init__(self, client: Client, address: str, progress: Told | None = None) -> None:
        self._client, self.address, self.progress = client, address, progress
        self.most_absent = ABSENT_S
        self._threads: dict[str, int] = {}
        self._counted = 0.0
        self._present: float | None = None
        self._sent: tuple[Any, Future] | None = None

    @property
    def workers(self) -> int:
        """Workers that are present."""
        return len(self.threads())

    @property
    def room(self) -> int:
        """Two tasks for each thread, so that none waits for the next, and one in spare."""
        return 2 * sum(self.threads().values()) + 1

    def threads(self) -> dict[str, int]:
        """The threads of each worker by its address, counted at most a second ago.

        Raises:
            ClusterError: the scheduler is gone, or there has been no worker for too long.
        """
        self.require()
        now = time.monotonic()
        if not self._threads or now - self._counted >= COUNT_S:
            try:
                self._threads = dict(self._client.nthreads())
            except Exception as error:
                raise self.lost() from error
            self._counted = time.monotonic()
        if self._threads or self._present is None:
            self._present = now
        elif now - self._present > self.most_absent:
            raise ClusterError(
                f"{self.address}: there has been no worker for {self.most_absent:.0f} s; start workers (dask worker "
                f"{self.address}) and repeat the command, with --resume where a checkpoint was kept"
            )
        return self._threads

    def submit(self, function: Callable[[Any, Any], Any], shared: Any, task: Any) -> Future:
        """Hand a task to the scheduler.

        Raises:
            ClusterError: the cluster was lost.
        """
        self.require()
        try:
            sent = None if shared is None else self._send(shared)
            return self._client.submit(at_worker, function, dict(here()), sent, task, pure=False, retries=0)
        except _GONE as error:
            raise self.lost() from error

    def _send(self, shared: Any) -> Future:
        """A shared value at one worker; each other takes it, once, from one that has it.

        The last is kept there for the next run of tasks.

        Raises:
            ClusterError: the cluster was lost.
        """
        while self._sent is None or self._sent[0] is not shared:
            self._sent = None
            if not self.threads():
                time.sleep(PATIENCE)
                continue
            try:
                self._sent = shared, self._client.scatter([shared], hash=False, timeout=_SEND_S)[0]
            except _GONE:  # a worker, or the scheduler
                self.require()
        return self._sent[1]

    def result(self, future: Future, number: int) -> Any:
        """See `lava_vpr.cluster.tasks.Runner`."""
        from distributed import CancelledError, KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            raise LostTaskError(error.allowed_failures + 1) from error
        except CancelledError as error:  # the shared value was with workers that are all gone: it is sent again
            self.require()
            self._sent = None
            raise LostTaskError(1) from error
        except LavaVprError:
            raise
        except Exception as error:
            if future.status != "error":  # it is done, but its result does not come
                raise self.lost() from error
            raise ClusterError(f"task {number + 1} failed at a worker: {_named(error)}; its log says more") from error

    def end(self, unfinished: Collection[Future]) -> None:
        """See `lava_vpr.cluster.tasks.Runner`; a worker ends the task that it is at, whose result is dropped."""
        with suppress(Exception):  # the scheduler may be gone
            if unfinished and self._client.status == "running":
                self._client.cancel(list(unfinished), force=True)

    def require(self) -> None:
        """Refuse to go on without the scheduler.

        Raises:
            ClusterError: it is gone.
        """
        if self._client.status != "running":
            raise self.lost()

    def lost(self) -> ClusterError:
        """What is said when the scheduler is gone."""
        return ClusterError(
            f"{self.address}: the scheduler was lost; start it again (dask scheduler) and repeat the command, with "
            "--resume where a checkpoint was kept"
        )


def _named(error: BaseException) -> str:
    """An error in one line, with its class."""
    text = " ".join(str(error).split())
    at_end, of_connection = re.subn(r"^in <[^<>]*>: ", "", text)  # an object's address tells nobody anything
    if of_connection:
        return at_end
    if type(error) is Exception:  # what distributed makes of one that it cannot send
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def at_worker(function: Callable[[Any, Any], Any], expected: Mapping[str, str], shared: Any, task: Any) -> Any:
    """``function(shared, task)`` at a worker that is as ``expected`` (`here` of who asks).

    Raises:
        ClusterError: it is another; one that comes late was not compared before.
        Exception: what the function raises.
    """
    other = difference(expected, here())
    if other is not None:
        raise ClusterError(_differs("a worker that came late", other))
    return function(shared, task)


def _differs(worker: str, other: str) -> str:
    return f"{worker} has {other}; install the same versions on all machines, and restart the workers"


@contextmanager
def connected(address: str | None, progress: Told | None = None) -> Iterator[Connection | None]:
    """The cluster whose scheduler is at ``address``, until the end of the block; None if there is no address.

    Args:
        address: ``tcp://HOST:PORT``, or ``tls://HOST:PORT`` with keys that Dask's own configuration names.
        progress: Progress callback.
    Raises:
        ClusterError: Dask is not installed; nobody answers there, or not in time; there are no workers; or one has
            other versions than this process.
    """
    if address is None:
        yield None
        return
    client = _client(address)
    try:
        connection = Connection(client, address, progress)
        _check_workers(connection, client)
        yield connection
    finally:
        with suppress(Exception):
            client.close(timeout=2)


def _client(address: str) -> Client:
    """A client of the scheduler at ``address``.

    Raises:
        ClusterError: as `connected`.
    """
    try:
        import dask
        from distributed import Client, Security
        from distributed.versions import VersionMismatchWarning
    except ImportError as error:
        raise ClusterError(f"--cluster needs Dask, which is not installed ({error.name}): {INSTALL}") from None

    class OneLineClient(Client):
        """A client that ends, and with one sort of error, where somebody answers who is no scheduler."""

        async def _ensure_connected(self, timeout: Any = None) -> None:
            try:
                await super()._ensure_connected(timeout=timeout)
            except Exception as error:  # what it is told can raise anything; it would be left half open
                raise OSError from error.__cause__ or error

    # We say ourselves, in one line, what it would log or warn of; large tasks are meant to be.
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    warnings.filterwarnings("ignore", category=VersionMismatchWarning)
    dask.config.set({"distributed.admin.large-graph-warning-threshold": "1GiB"})
    _check_address(address, Security().get_connection_args("client").get("ssl_context"))
    try:
        connect = partial(OneLineClient, address, timeout=CONNECT_S, set_as_default=False, name="lava-vpr")
        return stoppable(connect, CONNECT_S + 1)  # it waits for ever for somebody who listens but is no scheduler
    except Exception as error:
        raise ClusterError(
            f"no scheduler of a cluster answers ({_named(error.__cause__ or error)}); start one there (dask scheduler) "
            f"and name what it prints as its address: {brief(address)} was given"
        ) from None


def _check_address(address: str, keys: object) -> None:
    """Refuse an address before a client is made of it: one that is refused later is never closed, and may hang others.

    Args:
        address: What --cluster names.
        keys: What Dask's configuration says of keys for TLS; None: nothing.
    Raises:
        ClusterError: it is none, or needs keys.
    """
    form = re.fullmatch(r"(tcp|tls)://(\[[0-9A-Fa-f:.%]+\]|[^\s/:\[\]]+):([0-9]{1,5})", address)
    if form is None or not 0 < int(form[3]) < 65536:
        raise ClusterError(f"--cluster takes tcp://HOST:PORT, not {brief(address)}; name what dask scheduler prints")
    if form[1] == "tls" and keys is None:
        raise ClusterError(
            f"{address}: Dask's configuration names no keys for TLS; set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, and "
            "..._TLS__CLIENT__CERT and ..._TLS__CLIENT__KEY"
        )


def _check_workers(connection: Connection, client: Client) -> None:
    """Wait for the first worker, and compare all that are there with this process.

    Raises:
        ClusterError: there is none, or one has other versions.
    """
    address, end = connection.address, time.monotonic() + WORKERS_S
    while not connection.threads():
        if time.monotonic() > end:
            raise ClusterError(f"{address}: the cluster has no workers; start some: dask worker {address}")
        time.sleep(0.1)
    try:
        found: dict[str, Any] = client.run(here, on_error="return")
    except Exception as error:  # a worker that cannot even load the question raises it whole
        raise ClusterError(f"{address}: a worker cannot run lava-vpr ({_named(error)}); install it there") from None
    for worker, theirs in found.items():
        if isinstance(theirs, BaseException):
            raise ClusterError(f"worker {worker} cannot run lava-vpr ({_named(theirs)}); install it there")
        other = difference(here(), theirs)
        if other is not None:
            raise ClusterError(_differs(f"worker {worker}", other))


COMPUTES = ("numpy", "numba", "scipy", "opencv-python-headless")
"""Packages whose versions can change a result."""


def that_compute() -> Mapping[str, str]:
    """Versions of Python, and of the packages that compute, by name."""
    return {"Python": platform.python_version()} | {name: version(name) for name in COMPUTES}


@cache
def here() -> Mapping[str, str]:
    """Versions by name that a cluster's machines must share: of this package with a hash of its source, those of
    `that_compute`, and of what machines talk with."""
    own = {"lava-vpr": f"{__version__} ({_source()})"}
    return {**own, **that_compute(), "distributed": version("distributed")}


def _source() -> str:
    """A hash of the package's modules, 12 digits: two checkouts of one version are not the same program."""
    modules: dict[str, Path] = {}
    for name in ("", "processes", "deploy"):  # the last two are beside the package in a checkout, in it elsewhere
        spec = find_spec(f"lava_vpr.{name}".rstrip("."))
        for root in spec.submodule_search_locations or () if spec is not None else ():
            found = {path.relative_to(root).as_posix(): path for path in Path(root).rglob("*.py")}
            modules |= {f"{name}/{own}".lstrip("/"): path for own, path in found.items()}
    digest = hashlib.sha256()
    for own, path in sorted(modules.items()):
        digest.update(own.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


def difference(ours: Mapping[str, str], theirs: Mapping[str, str]) -> str | None:
    """What differs, in words: ``numpy 1.26.4, here 1.26.3``; None if nothing does."""
    named = [f"{name} {theirs.get(name, 'none')}, here {own}" for name, own in ours.items() if theirs.get(name) != own]
    return "; ".join(named) or None
