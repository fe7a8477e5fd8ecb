"""Tasks on threads of this process: in order, as they are done, no more at once than can run, ended by an error."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lava_vpr.cluster.tasks import GivenUpError, Pool, Standing
from lava_vpr.errors import ConfigError


def shorter_later(shared: int, task: int) -> tuple[int, int]:
    """The later the task, the sooner it is done."""
    time.sleep((shared - task) / 20_000)
    return shared, task


@given(tasks=st.integers(0, 20), jobs=st.integers(1, 5))
def test_results_come_in_the_order_of_the_tasks(tasks: int, jobs: int) -> None:
    found = Pool(jobs).map(shorter_later, range(tasks), shared=20)
    assert list(found) == [(20, task) for task in range(tasks)]


def test_or_each_as_soon_as_it_is_done() -> None:
    first = threading.Event()

    def waiting(shared: None, task: int) -> int:
        if task == 0:
            assert first.wait(60)
        return task

    found = []
    for number, result in Pool(2).as_done(waiting, range(3), shared=None):
        assert number == result
        found.append(number)
        if len(found) == 2:
            first.set()
    assert sorted(found) == [0, 1, 2]
    assert found[-1] == 0


def test_a_slow_first_task_does_not_let_the_others_pile_up() -> None:
    """Tasks and results can be large: what waits for one before it takes the room of tasks that could run."""
    made, go = [], threading.Event()

    def tasks() -> Iterator[int]:
        for task in range(100):
            made.append(task)
            yield task

    def first_is_slow(shared: None, task: int) -> int:
        if task == 0:
            assert go.wait(60)
        return task

    def told(standing: Standing) -> None:
        if standing.done >= 2:  # of three that were made at once, the first still waits
            go.set()

    found = []
    for result in Pool(2).map(first_is_slow, tasks(), shared=None, progress=told):
        found.append(result)
        if result == 0:
            assert len(made) <= 4
    assert found == list(range(100))


def test_an_error_stops_the_others_and_is_raised() -> None:
    stop, begun = threading.Event(), []

    def failing(shared: None, task: int) -> int:
        begun.append(task)
        if task == 1:
            raise ConfigError("1 is too many")
        assert stop.wait(60)
        return task

    with pytest.raises(ConfigError, match=r"^1 is too many$"):
        list(Pool(2).map(failing, range(50), shared=None, stop=stop))
    assert len(begun) <= 3


def test_who_gives_up_stops_what_runs() -> None:
    stop = threading.Event()

    def until_stopped(shared: None, task: int) -> int:
        assert task == 0 or stop.wait(60)
        return task

    found = Pool(2).map(until_stopped, range(50), shared=None, stop=stop)
    assert next(found) == 0
    found.close()  # type: ignore[attr-defined]
    assert stop.is_set()


def test_who_gives_up_stops_the_tasks_of_tasks() -> None:
    """A task that learns a model is minutes of work; Ctrl-C waits for no more than one of its own tasks."""
    begun, own, ended = threading.Event(), threading.Event(), []

    def learning(shared: None, task: int) -> int:
        if task == 0:
            assert begun.wait(60)
        else:
            try:
                list(Pool().map(until_stopped, range(50), shared=None, stop=own))
            except GivenUpError:
                ended.append(task)
                raise
        return task

    def until_stopped(shared: None, task: int) -> int:
        begun.set()
        assert own.wait(60)
        return task

    found = Pool(2).map(learning, range(2), shared=None)
    assert next(found) == 0
    found.close()
    assert ended == [1]
    assert list(Pool(2).map(learning, range(1), shared=None)) == [0]  # what a thread knew is gone with its run


def test_progress_is_told_of_every_task() -> None:
    told: list[Standing] = []
    list(Pool().map(shorter_later, range(3), shared=3, called="blocks", progress=told.append))
    assert told == [Standing("blocks", done, 0) for done in range(4)]
