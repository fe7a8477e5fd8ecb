"""The option ``--cluster``: who else does the work, what is sent to it, and its progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import click

from lava_vpr.cli.common import progress_bar, stderr
from lava_vpr.cluster.connection import connected
from lava_vpr.cluster.tasks import Pool, Standing
from lava_vpr.engine.presentations import cores

cluster_option = click.option(
    "--cluster",
    "address",
    default=None,
    metavar="ADDRESS",
    help="Dask cluster that does the work: tcp://HOST:PORT, as dask scheduler prints it (extra 'cluster').",
)


class _Told:
    """A bar for each run of tasks, and a line when the number of workers changes."""

    def __init__(self, bars: ExitStack, address: str, workers: int) -> None:
        self._bars, self._address, self._workers = bars, address, workers
        self._called, self._done = "", 0
        self._advance: Callable[[int, str], None] | None = None

    def __call__(self, standing: Standing) -> None:
        if self._advance is None or standing.called != self._called or standing.done < self._done:
            self._bars.close()
            self._called, self._done = standing.called, 0
            text = f"{standing.called} on {self._address}"
            self._advance = self._bars.enter_context(progress_bar(text, standing.total or 0))
        if standing.workers != self._workers:
            self._workers = standing.workers
            stderr.print(f"note: {self._address}: {_workers(standing.workers)}")
        self._advance(standing.done - self._done, _workers(standing.workers))
        self._done = standing.done
        if standing.done == standing.total:
            self._bars.close()
            self._advance = None


def _workers(number: int) -> str:
    return f"{number} worker{'s' if number != 1 else ''}"


@contextmanager
def pool_at(address: str | None, threads: int | None = None) -> Iterator[Pool]:
    """The cluster at ``address``, with each run's progress on stderr; without one, one thread per processor.

    Raises:
        ClusterError: as `lava_vpr.cluster.connection.connected`.
    """
    with connected(address) as cluster, ExitStack() as bars:
        if cluster is not None:
            workers = cluster.threads()
            stderr.print(f"note: {cluster.address}: {_workers(len(workers))}, threads in all: {sum(workers.values())}")
            cluster.progress = _Told(bars, cluster.address, len(workers))
        yield Pool(threads or cores(), cluster)
