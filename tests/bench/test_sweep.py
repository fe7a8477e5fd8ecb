"""The search for cheaper settings: fronts, early stopping, and points that mean what they say."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from support.common.daskcluster import DaskCluster
from support.common.small_models import encoded, small_model, tiny_paper

from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.bench.results import SweepPoint
from lava_vpr.bench.sweep import FAST, MODEL, on_front, sweep
from lava_vpr.cluster.connection import connected
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.constants import LOIHI_1
from lava_vpr.deploy.bundle.compression import requantised
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost.between_queries import outside_steps
from lava_vpr.deploy.cost.closed_form import step_picojoules
from lava_vpr.deploy.cost.costs import all_microseconds, modelled
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import ConfigError
from lava_vpr.experiments.task import Case, Run, configured, current, fast_settings, figures, leads, run_of, stops
from lava_vpr.recognition import DECODERS_ONLY, recognise
from lava_vpr.training.loop import train

TRUTH = np.eye(8, dtype=bool)


def case() -> Case:
    return Case(small_model(), encoded(8, noise=0.6), TRUTH)


@lru_cache(maxsize=1)
def found() -> tuple[tuple[SweepPoint, ...], int]:
    """A short search, and how many points it said were done."""
    done: list[int] = []
    one = case()
    return sweep(one, budget=10, advance=done.append), sum(done)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(arrays(np.float64, st.tuples(st.integers(1, 12), st.just(3)), elements=st.sampled_from([0.0, 1.0, 2.0, 3.0])))
def test_the_front_is_what_nothing_outdoes(points: np.ndarray) -> None:
    for kept, point in zip(on_front(points), points.tolist(), strict=True):
        outdone = any(all(a <= b for a, b in zip(one, point, strict=True)) and one != point for one in points.tolist())
        assert kept != outdone


def test_a_query_stops_with_the_first_lead_above_the_margin() -> None:
    lead = np.array([[0.0, 1.0, 3.0], [0.0, 0.5, 1.0], [2.0, 0.0, 0.0]])
    assert stops(lead, 1.0).tolist() == [3, 3, 1]
    assert stops(lead, 0.4).tolist() == [2, 2, 1]
    assert stops(lead, np.inf).tolist() == [3, 3, 3]


def _literal(run: Run, margin: float) -> tuple[list[int], list[int]]:
    """Steps and answers of each query, counting spike by spike."""
    shares = run.model.responses / np.maximum(run.model.responses.sum(axis=1, keepdims=True), 1)
    steps, answers = [], []
    for film in run.trains.exc:
        scores = np.zeros(shares.shape[1])
        run_for = 0
        for spikes in film:
            run_for += 1
            scores = scores + spikes @ shares
            second, best = sorted(scores)[-2:]
            if best - second > margin:
                break
        steps.append(run_for)
        answers.append(int(scores.argmax()) if scores.any() else -1)
    return steps, answers


@pytest.mark.parametrize("margin", [0.3, 1.7, 4.1])
def test_early_stopping_against_spike_by_spike(margin: float) -> None:
    """Recall, energy and time of the steps that were run, and of the clearing."""
    one = case()
    run = run_of(one, current(one.model), KAPOHO_BAY, 1)
    (result,) = figures(run, [margin])
    steps, answers = _literal(run, margin)
    assert stops(leads(run.model, np.cumsum(run.trains.exc, axis=1, dtype=np.int32)), margin).tolist() == steps
    assert min(steps) < run.trains.exc.shape[1]
    assert result.steps == pytest.approx(np.mean(steps))
    assert result.metrics.recall_at_1 == pytest.approx(np.mean(np.array(answers) == np.arange(8)))
    events, constants = count_events(run.plan, run.trains), LOIHI_1
    energy = sum(step_picojoules(events, constants, "nominal").values())
    time = all_microseconds(run.plan, events, constants, "nominal")
    microjoules, milliseconds = (cost.nominal for cost in outside_steps(run.plan, constants))
    microjoules += np.mean([energy[q, :ran].sum() for q, ran in enumerate(steps)]) / 1e6
    milliseconds += np.mean([time[q, :ran].sum() for q, ran in enumerate(steps)]) / 1e3
    assert result.microjoules == pytest.approx(microjoules)
    assert result.milliseconds == pytest.approx(milliseconds)


def test_a_point_is_the_model_quantised_anew_and_modelled() -> None:
    """Against the functions that evaluate and price a model anywhere else."""
    one = case()
    wanted = {**current(one.model), "weight_bits": 2.0, "steps": 32.0, "prune": 0.5, "query_inputs": 300.0}
    run = run_of(one, wanted, KAPOHO_BAY, 1)
    (result,) = figures(run, [np.inf])
    changes = {"encoder": {"query_inputs": 300}, "network": {"weight_bits": 2, "steps": 32, "prune": 0.5}}
    source = dataclasses.replace(one.model, config=update(one.model.config, changes))
    model = requantised(source)
    assert recognise(model, one.queries, TRUTH, DECODERS_ONLY).metrics["contrast"] == result.metrics
    plan = plan_of(model, KAPOHO_BAY)
    rates = query_rates(one.queries.activity, model.config)
    trains = HostBackend().trains(model, Presentations(rates, model.config.seed))
    told = modelled(plan, count_events(plan, trains)).figures
    assert result.microjoules == pytest.approx(told.dynamic_microjoules.nominal)
    assert result.milliseconds == pytest.approx(told.milliseconds.nominal)
    whole = told.dynamic_microjoules.nominal + 1e3 * told.wall_static_millijoules.nominal
    assert result.board_microjoules == pytest.approx(whole)


def _front(points: Sequence[SweepPoint]) -> list[SweepPoint]:
    costs = np.array([(-point.metrics.recall_at_1, point.microjoules, point.milliseconds) for point in points])
    return [point for point, kept in zip(points, on_front(costs), strict=True) if kept]


def test_a_search_tells_what_it_tried() -> None:
    points, done = found()
    assert done == 10
    assert points[0].chosen == MODEL
    assert points[0].settings == {}
    (fast,) = [point for point in points if point.chosen == FAST]
    assert fast.settings["query_spikes"] == preset("fast").encoder.query_spikes
    assert fast.microjoules < points[0].microjoules
    stopping = [point for point in points if "stop_margin" in point.settings]
    whole = [point for point in points if "stop_margin" not in point.settings]
    best = {id(point) for kind in (whole, points) for point in _front(kind)}
    assert [point.front for point in points] == [id(point) in best for point in points]
    assert any(point.front for point in whole)
    assert all(not point.chosen for point in stopping)
    assert min(point.mean_steps for point in stopping) < points[0].mean_steps


def test_equal_input_gives_equal_points() -> None:
    one = case()
    again = sweep(one, budget=10, pool=Pool(2))
    assert [repr(point) for point in again] == [repr(point) for point in found()[0]]


@pytest.mark.slow
def test_a_cluster_measures_the_points_of_one_machine(tmp_path: Path) -> None:
    """Eight at once, drawn as if the front stayed as it is; points drawn from another front are drawn again."""
    done: list[int] = []
    with DaskCluster(tmp_path) as made, connected(made.address) as cluster:
        again = sweep(case(), budget=10, pool=Pool(1, cluster), advance=done.append)
    assert [repr(point) for point in again] == [repr(point) for point in found()[0]]
    assert sum(done) == 10


def test_other_numbers_of_neurons_are_learned_again() -> None:
    one = case()
    run = run_of(one, {**current(one.model), "neurons_per_place": 1.5}, KAPOHO_BAY, 1)
    assert run.model.neurons == 12
    assert list(one.learned) == [1.5]
    # What the model kept of its references is enough to learn them the same again.
    config = update(one.model.config, {"network": {"neurons": 0, "neurons_per_place": 1.5}})
    assert np.array_equal(run.model.learned, train([encoded(8)], config).learned)


def test_settings_go_in_and_come_out() -> None:
    model = small_model()
    wanted = fast_settings(model)
    config = configured(model.config, wanted)
    assert current(dataclasses.replace(model, config=config)) == wanted


def test_what_cannot_be_swept_is_refused() -> None:
    one = case()
    with pytest.raises(ConfigError, match="no float weights to quantise again"):
        sweep(dataclasses.replace(one, model=dataclasses.replace(one.model, learned=np.zeros((0, 0), np.float32))))
    with pytest.raises(ConfigError, match="the search of settings needs an integer network"):
        current(dataclasses.replace(one.model, config=tiny_paper()))
