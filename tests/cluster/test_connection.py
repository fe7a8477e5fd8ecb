"""Tasks at the workers of a Dask cluster: two processes here, which are killed, are others, or are not there.

And tasks on threads of this process: in order, as they are done, no more at once than can run, ended by an error.
"""

from __future__ import annotations

import gc
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from support.common.daskcluster import DaskCluster, die, die_once, refuse, rest, times

from lava_vpr.cluster import connection, tasks
from lava_vpr.cluster.connection import Connection, connected
from lava_vpr.cluster.tasks import GivenUpError, Pool, Standing
from lava_vpr.errors import ClusterError, ConfigError


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    """Two workers; a test that kills some leaves two."""
    with DaskCluster(tmp_path_factory.mktemp("cluster")) as made:
        yield made


@pytest.fixture
def own(tmp_path: Path) -> Iterator[DaskCluster]:
    """A scheduler without workers."""
    with DaskCluster(tmp_path, workers=0) as made:
        yield made


@pytest.fixture
def at(cluster: DaskCluster) -> Iterator[Connection]:
    with connected(cluster.address) as found:
        yield found


def test_no_address_is_no_cluster() -> None:
    with connected(None) as found:
        assert found is None


def test_results_come_in_order_and_arrays_as_they_are(at: Connection) -> None:
    shared, told = np.arange(6, dtype=np.int16).reshape(2, 3), []
    at.progress = told.append
    numbers = [np.full((2, 3), number, np.int16) for number in range(9)]
    found = list(Pool(1, at).map(times, iter(numbers), shared=shared, called="blocks"))
    assert all(np.array_equal(one, shared * number) for number, one in enumerate(found))
    assert {(one.dtype, one.flags.writeable) for one in found} == {(np.dtype(np.int16), True)}
    assert told[-1] == Standing("blocks", 9, 2)


def test_an_error_of_ours_is_raised_as_it_is(at: Connection) -> None:
    with pytest.raises(ConfigError, match=r"^3 is too many; give 2$"):
        list(Pool(1, at).map(refuse, range(9), shared=0))
    assert list(Pool(1, at).map(refuse, range(3), shared=0)) == [0, 1, 2]


def test_any_other_error_is_one_line(at: Connection) -> None:
    with pytest.raises(ClusterError, match=r"^task 4 failed at a worker: ValueError: three lines; its log says more$"):
        list(Pool(1, at).map(refuse, range(9), shared=1))


def test_killed_workers_cost_their_tasks_alone(cluster: DaskCluster, at: Connection) -> None:
    """Even all at once, with what they all had been sent."""
    found = []
    for result in Pool(1, at).map(rest, range(8), shared=(np.ones(9), 0.1)):
        found.append(result)
        if result == 1:
            for worker in cluster.workers:
                worker.kill()
            cluster.workers = [cluster.add(), cluster.add()]
    assert found == list(range(8))


@pytest.fixture
def strict(tmp_path: Path) -> Iterator[DaskCluster]:
    """A cluster whose scheduler gives a task up when a single worker has died with it."""
    (tmp_path / "strict").mkdir()
    with DaskCluster(tmp_path / "strict", allowed_failures=0) as made:
        yield made


@pytest.mark.slow
def test_more_deaths_than_the_scheduler_allows_do_not_end_a_run(strict: DaskCluster, tmp_path: Path) -> None:
    """Dask gives the task up; here it is submitted again, for it may be chance."""
    strict.workers += [strict.add()]
    with connected(strict.address) as found:
        assert list(Pool(1, found).map(die_once, range(5), shared=str(tmp_path))) == list(range(5))
    assert len(list(tmp_path.glob("died-*"))) == 2
    assert sum(worker.poll() is None for worker in strict.workers) == 1


def test_a_task_that_kills_its_workers_is_not_run_for_ever(
    strict: DaskCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tasks, "DEATHS", 2)
    with connected(strict.address) as found, pytest.raises(ClusterError) as refused:
        list(Pool(1, found).map(die, [0], shared=None))
    assert str(refused.value) == (
        "task 1: 2 workers have died with it, one after another; it may need more memory than they have (dask worker "
        "--memory-limit), and their logs say more"
    )


def slowly(found: Connection | None, at: int, do: Callable[[], object]) -> None:
    """Fifty tasks, and what is done once the result of one is here."""
    for result in Pool(1, found).map(rest, range(50), shared=(None, 0.05)):
        if result == at:
            do()


def test_a_scheduler_that_is_lost(own: DaskCluster) -> None:
    own.add()
    with connected(own.address) as found, pytest.raises(ClusterError) as refused:
        slowly(found, 1, own.scheduler.kill)
    assert str(refused.value) == (
        f"{own.address}: the scheduler was lost; start it again (dask scheduler) and repeat the command, with --resume "
        "where a checkpoint was kept"
    )


@pytest.mark.slow
def test_workers_that_do_not_come_back(own: DaskCluster) -> None:
    worker = own.add()
    with connected(own.address) as found:
        found.most_absent = 1.0
        with pytest.raises(ClusterError, match=r"there has been no worker for 1 s; start workers \(dask worker tcp://"):
            slowly(found, 0, worker.kill)


def refusal(address: str) -> str:
    """What is said of a cluster that cannot be connected to."""
    with pytest.raises(ClusterError) as refused, connected(address):
        raise AssertionError("it was")
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_no_workers(own: DaskCluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "WORKERS_S", 0.2)
    said = refusal(own.address)
    assert said == f"{own.address}: the cluster has no workers; start some: dask worker {own.address}"


def test_nobody_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "CONNECT_S", 0.5)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    said = refusal(f"tcp://127.0.0.1:{port}")
    assert said.startswith("no scheduler of a cluster answers (")
    remedy = "start one there (dask scheduler) and name what it prints as its address"
    assert said.endswith(f"{remedy}: 'tcp://127.0.0.1:{port}' was given")
    assert refusal("tcp://no.such.host.invalid:8786").startswith("no scheduler of a cluster answers (")


FRAME = struct.pack("<QQ", 1, 3)
"""How messages of Dask begin: one part, of so many bytes."""
ELSE = {
    "silent": b"",
    "web": b"HTTP/1.1 400 Bad Request\r\n\r\n",
    "noise": bytes(range(1, 255)),
    "huge": struct.pack("<Q", 1 << 62),
    "no message": struct.pack("<Q", len(FRAME) + 3) + FRAME + b"\xc1\xc1\xc1",
}


@pytest.mark.parametrize("said", ELSE)
def test_somebody_else_there(said: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """Who listens and says nothing, or what is no scheduler's word."""
    monkeypatch.setattr(connection, "CONNECT_S", 0.5)
    with socket.socket() as there:
        there.bind(("127.0.0.1", 0))
        there.listen()
        asked: list[socket.socket] = []

        def answer() -> None:
            asked.append(there.accept()[0])
            asked[0].sendall(ELSE[said])

        threading.Thread(target=answer, daemon=True).start()
        assert refusal(f"tcp://127.0.0.1:{there.getsockname()[1]}").startswith("no scheduler of a cluster answers (")
        asked[0].close()
    gc.collect()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "address",
    ["nonsense://1:2", "tcp://", "tcp://here:words", "127.0.0.1", "", "tcp://here", "tcp://a b:1", "tcp://here:65536"],
)
def test_no_address(address: str) -> None:
    said = refusal(address)
    assert said == f"--cluster takes tcp://HOST:PORT, not {address!r}; name what dask scheduler prints"


def test_tls_without_keys() -> None:
    said = refusal("tls://[::1]:8786")
    assert said.startswith("tls://[::1]:8786: Dask's configuration names no keys for TLS; set DASK_DISTRIBUTED__COMM_")


def test_dask_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "dask", None)
    said = refusal("tcp://127.0.0.1:1")
    assert said == "--cluster needs Dask, which is not installed (dask): pip install 'lava-vpr[cluster]'"


OTHER = "import lava_vpr; lava_vpr.__version__ = '0.0.9'"
NONE = "import sys; sys.modules['lava_vpr'] = None"


def test_a_worker_of_another_version(own: DaskCluster) -> None:
    own.add(program=OTHER)
    said, ours = refusal(own.address), connection.here()["lava-vpr"]
    assert f"has lava-vpr 0.0.9 ({ours.split('(')[1]}, here {ours}; install the same versions on all machines" in said


def test_a_worker_without_lava_vpr(own: DaskCluster) -> None:
    own.add(program=NONE)
    assert "cannot run lava-vpr (ModuleNotFoundError" in refusal(own.address)


def test_a_worker_of_another_version_that_comes_late(own: DaskCluster) -> None:
    first = own.add()
    with connected(own.address) as found, pytest.raises(ClusterError, match=r"^a worker that came late has lava-vpr"):
        slowly(found, 0, lambda: (own.add(program=OTHER), first.kill()))


def test_versions_name_what_computes() -> None:
    ours = dict(connection.here())
    assert connection.difference(ours, ours) is None
    theirs = {**ours, "numpy": "0.1"}
    assert connection.difference(ours, theirs) == f"numpy 0.1, here {ours['numpy']}"
    assert connection.difference(ours, {}) is not None


def test_another_source_is_another_program(monkeypatch: pytest.MonkeyPatch) -> None:
    before, read = connection._source(), Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + (b"#" if path.name == "loihi.py" else b""))
    assert connection._source() != before


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
