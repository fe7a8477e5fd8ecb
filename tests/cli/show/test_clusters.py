"""``--cluster``: two workers here, one of them killed in the middle, write the bytes that one machine writes."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from support.common import surroundings
from support.common.daskcluster import DaskCluster, made_keys

from lava_vpr.cli import main
from lava_vpr.cli.show import clusters
from lava_vpr.cluster import connection
from lava_vpr.cluster.tasks import Standing
from lava_vpr.engine import blocks
from lava_vpr.storage import container
from lava_vpr.synthetic.world import write_traverses
from lava_vpr.training import measuring

STRETCHES, EPOCHS = 6, 4
QUICK = f"stretch = 4\n[network]\nsteps = 64\n[learning]\nsteps = 200\nepochs = {EPOCHS}\n"


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[DaskCluster]:
    (tmp_path / "cluster").mkdir()
    with DaskCluster(tmp_path / "cluster") as made:
        yield made


@pytest.fixture
def route(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A synthetic route of 24 places, in stretches of 4, and blocks of few presentations."""
    write_traverses(tmp_path, 24, 0)
    (tmp_path / "quick.toml").write_text(QUICK)
    monkeypatch.chdir(tmp_path)
    for module in (blocks, measuring):
        monkeypatch.setattr(module, "BLOCK", 12)
    return tmp_path


def run(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def kill_at(monkeypatch: pytest.MonkeyPatch, called: str, kill: Callable[[], object]) -> list[Standing]:
    """Kill somebody once two of the tasks ``called`` so are done; what was told."""
    told: list[Standing] = []
    tell = clusters._Told.__call__

    def telling(self: clusters._Told, standing: Standing) -> None:
        told.append(standing)
        if standing.called == called and standing.done == 2:
            kill()
        tell(self, standing)

    monkeypatch.setattr(clusters._Told, "__call__", telling)
    return told


def killed_in_the_middle(
    cluster: DaskCluster, summer: object, winter: object, options: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """``train`` and ``eval``, here and at a cluster that loses a worker in each; model and figures are equal bytes."""
    to = ("--cluster", cluster.address)
    assert run("train", summer, "-o", "here.lvpr", *options).exit_code == 0
    with monkeypatch.context() as patched:
        patched.setattr(connection, "COUNT_S", 0.0)  # workers are counted at every step
        told = kill_at(patched, "stretches", cluster.workers[0].kill)
        learned = run("train", summer, "-o", "there.lvpr", *options, *to)
    assert learned.exit_code == 0, learned.output
    assert learned.stderr.splitlines()[0] == f"note: {cluster.address}: 2 workers, threads in all: 2"
    assert f"note: {cluster.address}: 1 worker" in learned.stderr.splitlines()
    stretches = max(standing.total or 0 for standing in told if standing.called == "stretches")
    assert stretches >= 3
    assert Path("there.lvpr").read_bytes() == Path("here.lvpr").read_bytes()
    assert not Path("there.lvpr.checkpoint").exists()

    cluster.workers = [cluster.workers[1], cluster.add()]
    assert run("eval", "here.lvpr", winter, "--json", "here.json").exit_code == 0
    with monkeypatch.context() as patched:
        kill_at(patched, "blocks", cluster.workers[0].kill)
        asked = run("eval", "here.lvpr", winter, "--json", "there.json", *to)
    assert asked.exit_code == 0, asked.output
    assert cluster.workers[0].poll() is not None
    assert Path("there.json").read_bytes() == Path("here.json").read_bytes()


def test_two_workers_one_of_them_killed_in_the_middle(
    route: Path, cluster: DaskCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed_in_the_middle(cluster, "reference", "query", ["--config", "quick.toml"], monkeypatch)


@pytest.mark.slow
@pytest.mark.data
def test_the_same_on_real_images(
    data_root: Path, tmp_path: Path, cluster: DaskCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The default preset on 200 places of a railway, a season apart."""
    monkeypatch.chdir(tmp_path)
    summer, winter = (data_root / "data" / "nordland" / season for season in ("summer", "winter"))
    options = ["--places", "0:200", "--stretch", "20"]
    killed_in_the_middle(cluster, summer, winter, options, monkeypatch)


@pytest.mark.slow
def test_a_lost_scheduler_is_one_line_and_training_resumes(
    route: Path, cluster: DaskCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stretches that had come back are in the checkpoint whole, and training goes on from it on one machine."""
    words = ("train", "reference", "-o", "m.lvpr", "--config", "quick.toml")
    with monkeypatch.context() as patched:
        kill_at(patched, "stretches", cluster.scheduler.kill)
        lost = run(*words, "--cluster", cluster.address)
    assert lost.exit_code == 1
    said = f"lava-vpr: error: {cluster.address}: the scheduler was lost; start it again"
    assert lost.stderr.splitlines()[-1].startswith(said)
    done = container.load(Path("m.lvpr.checkpoint"), "checkpoint")[0]["epochs"]
    assert (set(done.values()), len(done) < STRETCHES) == ({EPOCHS}, True)
    resumed = run(*words, "--resume")
    assert resumed.exit_code == 0
    assert f"resuming from m.lvpr.checkpoint; stretches finished: {len(done)} of {STRETCHES}" in resumed.stderr
    assert run(*words[:3], "whole.lvpr", *words[4:]).exit_code == 0
    assert Path("m.lvpr").read_bytes() == Path("whole.lvpr").read_bytes()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("openssl") is None, reason="keys for TLS are made by openssl")
def test_by_tls(route: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """With the keys the bytes of one machine; without them, or with others, one line."""
    folders = [tmp_path_factory.mktemp("keys") for _ in range(2)]
    known, strange = map(made_keys, folders)
    words = ("train", "reference", "--config", "quick.toml", "-o")
    assert run(*words, "here.lvpr").exit_code == 0
    with DaskCluster(tmp_path_factory.mktemp("cluster"), keys=folders[0]) as made:
        assert made.address.startswith("tls://127.0.0.1:")
        ended = surroundings.run(route, *words, "there.lvpr", "--cluster", made.address, set_to=known)
        assert ended.code == 0, ended.err
        assert ended.lines[0] == f"note: {made.address}: 2 workers, threads in all: 2"
        assert (route / "there.lvpr").read_bytes() == (route / "here.lvpr").read_bytes()
        for address, keys, said in (
            (made.address, {}, f"{made.address}: Dask's configuration names no keys for TLS; set DASK_DISTRIBUTED__"),
            (made.address, strange, "no scheduler of a cluster answers ("),
            (made.address.replace("tls", "tcp"), known, "no scheduler of a cluster answers ("),
        ):
            refused = surroundings.run(route, *words, "no.lvpr", "--cluster", address, set_to=keys)
            assert (refused.code, len(refused.lines), refused.made) == (1, 1, []), refused.err
            assert refused.err.startswith(f"lava-vpr: error: {said}"), refused.err


@pytest.mark.parametrize("command", [("train", "reference", "-o", "new.lvpr"), ("eval", "m.lvpr", "query")])
def test_nobody_answers(here: Path, command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "CONNECT_S", 0.3)
    refused = run(*command, "--cluster", "tcp://127.0.0.1:9")
    assert refused.exit_code == 1
    assert len(refused.stderr.splitlines()) == 1
    # Whether the attempt is refused or its time is up depends on the machine.
    assert refused.stderr.startswith("lava-vpr: error: no scheduler of a cluster answers (")
    assert (
        "start one there (dask scheduler) and name what it prints as its address: 'tcp://127.0.0.1:9'" in refused.stderr
    )
    assert not os.path.exists("new.lvpr")


def test_eval_shares_the_host_backend_alone(here: Path) -> None:
    refused = run("eval", "m.lvpr", "query", "--cluster", "tcp://127.0.0.1:9", "--backend", "lava-fixed")
    assert refused.exit_code == 2
    assert "--cluster runs the backend host, not lava-fixed; leave one of the two out" in refused.stderr


def test_bench_shares_the_sweep_alone(here: Path) -> None:
    refused = run("bench", "m.lvpr", "query", "--cluster", "tcp://127.0.0.1:9")
    assert refused.exit_code == 2
    assert "--cluster shares the points of --sweep; all else measures this machine: add --sweep" in refused.stderr
