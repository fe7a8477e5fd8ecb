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
from collections import Counter
from collections.abc import Callable, Collection, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

from lava_vpr.errors import ClusterError

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

PATIENCE = 0.2
"""Seconds after which a wait for a result is broken off, so that Ctrl-C is obeyed and workers are counted."""
DEATHS = 16
"""Workers that may die with a task, four times as many as a scheduler allows; then the task is taken for the cause."""

_thread = threading.local()
"""What a thread that is at a task knows: ``stop``, set when the run that the task belongs to is given up."""


class GivenUpError(Exception):
    """Raised out of a task that runs tasks of its own, when its run is given up; it is not reported."""


class LostTaskError(Exception):
    """A task that was lost with workers, so many of which have died with it now; it is to be submitted again."""

    def __init__(self, deaths: int) -> None:
        super().__init__(deaths)
        self.deaths = deaths


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
"""A function called with the state of the tasks whenever it has changed."""


class Runner:
    """Runs tasks on threads of this process; `lava_vpr.cluster.connection.Connection` on those of a cluster's workers.

    Args:
        jobs: Threads.
        stop: Set as soon as a task fails, or the run is given up.
    Attributes:
        progress: Default progress callback.
    """

    progress: Told | None = None

    def __init__(self, jobs: int, stop: threading.Event) -> None:
        self._jobs, self._stop, self._pool = max(1, jobs), stop, ThreadPoolExecutor(max(1, jobs))

    @property
    def room(self) -> int:
        """Tasks that are worth having at once; the rest is not made before one of these is done."""
        return self._jobs + 1

    @property
    def workers(self) -> int:
        """Workers of the cluster that are present; 0: threads of this process."""
        return 0

    def submit(self, function: Callable[[Any, Any], Any], shared: Any, task: Any) -> Any:
        """The future, of `concurrent.futures` or alike, of ``function(shared, task)``."""
        return self._pool.submit(self._guarded, function, shared, task)

    def _guarded(self, function: Callable[[Any, Any], Any], shared: Any, task: Any) -> Any:
        _thread.stop = self._stop
        try:
            return function(shared, task)
        except BaseException:
            self._stop.set()  # at once, before a thread takes up the next task
            raise

    def result(self, future: Any, number: int) -> Any:
        """What a future that is done, of task ``number``, came to.

        Raises:
            LostTaskError: nothing; the task is to be submitted again.
            Exception: what the task raised.
        """
        return future.result()

    def end(self, unfinished: Collection[Any]) -> None:
        """Drop the tasks that are not done."""
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
    cluster: Runner | None = None

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
        """The results of ``function(shared, task)`` for all ``tasks``, in their order, each as soon as it is known.

        Args:
            function: A function of a module; of this process alone, where there is no cluster, any.
            tasks: Plain values; only so many are made at once as workers or threads can use.
            shared: What every task takes first; sent to each worker once.
            called: What the tasks are, in the plural, for `Standing`.
            total: How many they are, if that is known, for the same.
            progress: Called with their state; None: the one named to the cluster, if any.
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
    runner = pool.cluster or Runner(pool.threads, stop or threading.Event())
    progress = progress or runner.progress
    numbered, done, more = enumerate(tasks), 0, True
    running: dict[Any, tuple[int, T]] = {}
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    deaths: Counter[int] = Counter()
    told: Standing | None = None
    above: threading.Event | None = getattr(_thread, "stop", None)

    def submit(number: int, task: T) -> None:
        future = runner.submit(function, shared, task)
        running[future] = number, task
        future.add_done_callback(ended.put)

    try:
        while True:
            while more and (not running or len(running) + len(ready) < runner.room):
                following = next(numbered, None)
                if following is None:
                    more = False
                else:
                    submit(*following)
            standing = Standing(told_as[0], done, runner.workers, told_as[1])
            if progress is not None and standing != told:
                told = standing
                progress(standing)
            if not running:
                return
            try:
                future = ended.get(timeout=PATIENCE)
            except queue.Empty:
                future = None
            if above is not None and above.is_set():
                raise GivenUpError
            if future is None:
                continue
            number, task = running.pop(future)
            try:
                result = runner.result(future, number)
            except LostTaskError as error:
                deaths[number] += error.deaths
                if deaths[number] >= DEATHS:
                    raise ClusterError(
                        f"task {number + 1}: {deaths[number]} workers have died with it, one after another; it may "
                        "need more memory than they have (dask worker --memory-limit), and their logs say more"
                    ) from error
                submit(number, task)
            else:
                done += 1
                yield number, result
    finally:
        runner.end(running)
