"""Tasks: a function of plain values, run for many of them, on threads of this process or by a cluster's workers.

A task is whatever can be worked out without the others: a stretch of a route, a block of presentations, a point of a
sweep or of a study. Results depend on function, shared value and task alone, so they are the same wherever they are
made. What is large and the same for all, such as references or a network, is the shared value: each worker gets it
once. A point of a study::

    @dataclass(frozen=True)
    class Point:  # plain values: numbers, words, arrays, settings
        config: Config
        places: int

    def measured(references: Shared, point: Point) -> Figures:  # of a module, not within another function
        ...

    with connected(address) as cluster:  # address: what --cluster names; None: cluster is None, and threads run
        points = (Point(config, places) for places in (25, 100, 400))
        for figures in Pool(threads, cluster).map(measured, points, shared=references, called="points"):
            ...  # in the order of the points, each as soon as it and those before it are done

A point runs on one thread of its worker; it must not use a cluster itself. What it raises is raised here: a
`LavaVprError` as it is. A task may run tasks of its own on threads here, as learning a model does; they are given up
with it.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

PATIENCE = 0.2
"""Seconds after which a wait for a result is broken off, so that Ctrl-C is minded and workers are counted."""

_thread = threading.local()
"""What a thread that is at a task knows: ``stop``, set when the run that the task belongs to is given up."""


class GivenUpError(Exception):
    """Raised out of a task that runs tasks of its own, when the run that it belongs to is given up; nobody is told."""


@dataclass(frozen=True)
class Standing:
    """Where a run of tasks stands.

    Attributes:
        called: What the tasks are, in the plural.
        done: Tasks whose results are here.
        workers: Workers of the cluster; 0: threads of this process.
        total: All tasks; None: that is not known.
    """

    called: str
    done: int
    workers: int
    total: int | None = None


Told = Callable[[Standing], None]
"""A function that is told where tasks stand, whenever that has changed."""


class TaskRunner(Protocol):
    """Whoever runs the tasks of one call: threads here, or a cluster's workers.

    Attributes:
        room: Tasks that are worth having at once; the rest is not made before one of these is done.
        workers: Workers of the cluster that are present; 0: threads of this process.
    """

    @property
    def room(self) -> int: ...

    @property
    def workers(self) -> int: ...

    def submit(self, number: int, task: Any) -> None: ...

    def wait(self, seconds: float) -> tuple[int, Any] | None:
        """The number and the result of a task that is done; None after so many seconds without one.

        Raises:
            Exception: what the task raised.
        """
        ...

    def end(self) -> None:
        """Drop the tasks that are not done."""
        ...


class Cluster(Protocol):
    """Workers that take tasks (`lava_vpr.cluster.connection.Connection`).

    Attributes:
        progress: Told where tasks stand, unless their own call names somebody.
    """

    progress: Told | None

    def running(self, function: Callable[[Any, Any], Any], shared: Any) -> TaskRunner: ...


class _Threads:
    """Threads of this process."""

    workers = 0

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, jobs: int, stop: threading.Event) -> None:
        self._function, self._shared, self._stop = function, shared, stop
        self._pool = ThreadPoolExecutor(max(1, jobs))
        self._done: queue.SimpleQueue[tuple[int, Future[Any]]] = queue.SimpleQueue()
        self.room = max(1, jobs) + 1

    def submit(self, number: int, task: Any) -> None:
        self._pool.submit(self._guarded, task).add_done_callback(lambda future: self._done.put((number, future)))

    def _guarded(self, task: Any) -> Any:
        _thread.stop = self._stop
        try:
            return self._function(self._shared, task)
        except BaseException:
            self._stop.set()  # at once, before a thread takes up the next task
            raise

    def wait(self, seconds: float) -> tuple[int, Any] | None:
        try:
            number, future = self._done.get(timeout=seconds)
        except queue.Empty:
            return None
        return number, future.result()

    def end(self) -> None:
        self._stop.set()
        self._pool.shutdown(wait=True, cancel_futures=True)


@dataclass(frozen=True)
class Pool:
    """Who runs tasks: threads of this process, or a cluster's workers. It changes no result.

    Attributes:
        threads: Threads of this process.
        cluster: Whose workers run tasks instead; None: those threads.
    """

    threads: int = 1
    cluster: Cluster | None = None

    @property
    def here(self) -> bool:
        """Whether this process runs the tasks."""
        return self.cluster is None

    def map(
        self,
        function: Callable[[S, T], R],
        tasks: Iterable[T],
        *,
        shared: S,
        called: str = "tasks",
        total: int | None = None,
        progress: Told | None = None,
        stop: threading.Event | None = None,
    ) -> Generator[R, None, None]:
        """The results of ``function(shared, task)`` for all ``tasks``, in their order, each as soon as it can be told.

        Args:
            function: A function of a module; of this process alone, where there is no cluster, any.
            tasks: Plain values; only so many are made at once as workers or threads can use.
            shared: What every task takes first; sent to each worker once.
            called: What the tasks are, in the plural, for `Standing`.
            total: How many they are, if that is known, for the same.
            progress: Told where they stand; None: who was named to the cluster, if anybody was.
            stop: Set as soon as one fails or the run is given up; what runs here can look at it and end early.
        Raises:
            ClusterError: the cluster was lost, or a task ends its workers.
            Exception: what a task raised; the rest is not run.
        """
        ready: dict[int, R] = {}
        due = 0
        for number, result in _results(self, function, tasks, shared, (called, total), progress, stop, ready):
            ready[number] = result
            while due in ready:
                yield ready.pop(due)
                due += 1

    def as_done(
        self,
        function: Callable[[S, T], R],
        tasks: Iterable[T],
        *,
        shared: S,
        called: str = "tasks",
        total: int | None = None,
        progress: Told | None = None,
        stop: threading.Event | None = None,
    ) -> Generator[tuple[int, R], None, None]:
        """`map` without their order: the number of each task, from 0, and its result, as soon as it is done."""
        return _results(self, function, tasks, shared, (called, total), progress, stop, {})


ONE_THREAD = Pool()
"""Runs tasks one after another."""


def _results(
    pool: Pool,
    function: Callable[[S, T], R],
    tasks: Iterable[T],
    shared: S,
    told_as: tuple[str, int | None],
    progress: Told | None,
    stop: threading.Event | None,
    ready: dict[int, R],
) -> Generator[tuple[int, R], None, None]:
    """Results as they come; those in ``ready`` wait for one before them, and take the room of tasks that could run."""
    running: TaskRunner
    if pool.cluster is None:
        running = _Threads(function, shared, pool.threads, stop or threading.Event())
    else:
        running = pool.cluster.running(function, shared)
        progress = progress or pool.cluster.progress
    numbered, pending, done, more = enumerate(tasks), 0, 0, True
    told: Standing | None = None
    above: threading.Event | None = getattr(_thread, "stop", None)
    try:
        while True:
            while more and (pending == 0 or pending + len(ready) < running.room):
                following = next(numbered, None)
                if following is None:
                    more = False
                else:
                    running.submit(*following)
                    pending += 1
            standing = Standing(told_as[0], done, running.workers, told_as[1])
            if progress is not None and standing != told:
                told = standing
                progress(standing)
            if not pending:
                return
            found = running.wait(PATIENCE)
            if above is not None and above.is_set():
                raise GivenUpError
            if found is not None:
                pending, done = pending - 1, done + 1
                yield found
    finally:
        running.end()
