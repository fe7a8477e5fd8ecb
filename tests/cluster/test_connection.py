"""Tasks at the workers of a Dask cluster: two processes here, which are killed, are others, or are not there."""

from __future__ import annotations

import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from support.common.daskcluster import DaskCluster, die, die_once, refuse, rest, times

from lava_vpr.cluster import connection, tasks, versions
from lava_vpr.cluster.connection import Connection, connected
from lava_vpr.cluster.tasks import Pool, Standing
from lava_vpr.errors import ClusterError, ConfigError


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    """Two workers; a test that kills some leaves two."""
    made = DaskCluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.end()


@pytest.fixture
def own(tmp_path: Path) -> Iterator[DaskCluster]:
    """A scheduler without workers."""
    made = DaskCluster(tmp_path, workers=0)
    yield made
    made.end()


@pytest.fixture
def at(cluster: DaskCluster) -> Iterator[Connection]:
    with connected(cluster.address) as found:
        assert found is not None
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
    made = DaskCluster(tmp_path / "strict", allowed_failures=0)
    yield made
    made.end()


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
        assert found is not None
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
    remedy = "start one there (dask scheduler), and name what it prints as its address"
    assert said.endswith(f"{remedy}: 'tcp://127.0.0.1:{port}' was given")
    assert refusal("tcp://no.such.host.invalid:8786").startswith("no scheduler of a cluster answers (")


def test_somebody_else_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who listens and says nothing."""
    monkeypatch.setattr(connection, "CONNECT_S", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        assert refusal(f"tcp://127.0.0.1:{silent.getsockname()[1]}").startswith("no scheduler of a cluster answers (")


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
    said, ours = refusal(own.address), versions.here()["lava-vpr"]
    assert f"has lava-vpr 0.0.9 ({ours.split('(')[1]}, here {ours}; install the same versions on all machines" in said


def test_a_worker_without_lava_vpr(own: DaskCluster) -> None:
    own.add(program=NONE)
    assert "cannot run lava-vpr (ModuleNotFoundError" in refusal(own.address)


def test_a_worker_of_another_version_that_comes_late(own: DaskCluster) -> None:
    first = own.add()
    with connected(own.address) as found, pytest.raises(ClusterError, match=r"^a worker that came late has lava-vpr"):
        slowly(found, 0, lambda: (own.add(program=OTHER), first.kill()))


def test_versions_name_what_computes() -> None:
    ours = dict(versions.here())
    assert versions.difference(ours, ours) is None
    theirs = {**ours, "numpy": "0.1"}
    assert versions.difference(ours, theirs) == f"numpy 0.1, here {ours['numpy']}"
    assert versions.difference(ours, {}) is not None


def test_another_source_is_another_program(monkeypatch: pytest.MonkeyPatch) -> None:
    before, read = versions._source(), Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + (b"#" if path.name == "loihi.py" else b""))
    assert versions._source() != before
