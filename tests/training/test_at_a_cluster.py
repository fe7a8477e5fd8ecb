"""Stretches, references and queries as tasks of a cluster: the bytes of one machine, whatever is lost."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.common.daskcluster import DaskCluster
from support.common.small_models import encoded, paper_model, small_config, small_model, tiny_paper

from lava_vpr import model
from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.cluster.connection import Connection, connected
from lava_vpr.cluster.tasks import Pool, Standing
from lava_vpr.config import Config
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine import blocks
from lava_vpr.model import Model
from lava_vpr.recognition import EVERYTHING, as_json, recognise
from lava_vpr.storage import container
from lava_vpr.training import measuring
from lava_vpr.training.loop import train
from lava_vpr.training.measuring import calibrated

SEVERAL = {"stretch": 3}  # 8 places in 3 stretches


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    with DaskCluster(tmp_path_factory.mktemp("cluster")) as made:
        yield made


@pytest.fixture
def at(cluster: DaskCluster, monkeypatch: pytest.MonkeyPatch) -> Iterator[Connection]:
    """The two workers, and blocks of few presentations."""
    for module in (blocks, measuring):
        monkeypatch.setattr(module, "BLOCK", 3)
    with connected(cluster.address) as found:
        assert found is not None
        yield found


def saved(trained: Model, folder: Path) -> bytes:
    model.save(trained, folder / "model")
    return (folder / "model").read_bytes()


def cases() -> dict[str, tuple[Config, list[EncodedTraverse]]]:
    two = [encoded(), dataclasses.replace(encoded(noise=0.5), indices=np.arange(8) + 5)]
    views = [encoded(), encoded(noise=0.2), encoded(noise=0.4)]
    return {
        "one traverse": (update(small_config(), SEVERAL), [encoded()]),
        "two traverses": (update(small_config(), SEVERAL), two),
        "three views": (update(small_config(), SEVERAL | {"views": {"shifts": 3}}), views),
        "integers": (update(small_config(learning={"arithmetic": "integer"}), SEVERAL), [encoded()]),
        "templates": (update(small_config(learning={"rule": "template"}), SEVERAL), two),
        "paper": (tiny_paper(), [encoded(inputs=784)]),
    }


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", list(cases()))
def test_a_model_has_the_bytes_of_one_machine(at: Connection, name: str, tmp_path: Path) -> None:
    config, shown = cases()[name]
    told: list[Standing] = []
    at.progress = told.append
    here, there = train(shown, config), train(shown, config, pool=Pool(1, at))
    assert saved(calibrated(here), tmp_path) == saved(calibrated(there, Pool(1, at)), tmp_path)
    stretches = len(here.stretches)
    assert Standing("stretches", stretches, 2, stretches) in told
    assert ("blocks" in {standing.called for standing in told}) == (name != "paper")


class EnoughError(Exception):
    """Stands for whatever ends a training before it is done."""


def test_training_goes_on_at_the_cluster_from_whole_epochs(at: Connection, tmp_path: Path) -> None:
    config, shown = cases()["two traverses"]
    checkpoint, seen = tmp_path / "a.checkpoint", []

    def some(state: object) -> None:
        seen.append(state)
        if len(seen) == 13:
            raise EnoughError

    with pytest.raises(EnoughError):
        train(shown, config, checkpoint=checkpoint, interval=0.0, progress=some)
    assert 0 < sum(container.load(checkpoint, "checkpoint")[0]["epochs"].values()) < config.learning.epochs
    resumed = train(shown, config, checkpoint=checkpoint, resume=True, pool=Pool(1, at))
    assert saved(resumed, tmp_path) == saved(train(shown, config), tmp_path)


@pytest.mark.parametrize("paper", [False, True])
def test_queries_have_the_counts_and_events_of_one_machine(at: Connection, paper: bool) -> None:
    trained = paper_model() if paper else small_model()
    shown = query_presentations(trained, encoded(noise=0.5, inputs=784 if paper else trained.config.encoder.inputs))
    here, events = HostBackend().count_spikes(trained, shown)
    there, the_same = HostBackend(Pool(1, at)).count_spikes(trained, shown)
    assert here.any()
    assert np.array_equal(here, there)
    assert (here.dtype, events) == (there.dtype, the_same)


def test_figures_with_every_baseline_are_those_of_one_machine(at: Connection) -> None:
    trained, queries = small_model(), encoded(noise=0.5)
    told: list[Standing] = []
    at.progress = told.append
    here, there = (
        as_json(trained, recognise(trained, queries, np.eye(8, dtype=bool), EVERYTHING, pool=Pool(1, asked)))
        for asked in (None, at)
    )
    assert here == there
    assert {standing.called for standing in told} == {"blocks", "stretches"}  # stretches of the baseline template
