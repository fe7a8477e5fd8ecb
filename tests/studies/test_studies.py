"""Studies on a small made-up route: points that mean what they say, and the same figures every time; the command."""

from __future__ import annotations

import dataclasses
import json
import pickle
import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from statistics import mean, stdev

import numpy as np
import pytest
from support.common import commands
from support.common.browser import PHONE, on_phone, visit
from support.common.commands import images, listed
from support.common.daskcluster import DaskCluster
from support.common.small_models import encoded, small_config, tiny_paper

from lava_vpr.cluster.tasks import Pool
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.memory import PackedRows
from lava_vpr.deploy.bundle.compression import Changes, requantised
from lava_vpr.errors import ConfigError
from lava_vpr.experiments import task as measuring
from lava_vpr.experiments.grid import Outcome, Row, Spread, rows
from lava_vpr.experiments.task import MODELLED, NETWORK, Costs, Route, counted, learned, modelled
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.ensembles import hyperactive
from lava_vpr.matching.evaluation import Recall, evaluate
from lava_vpr.model import Model, decode
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.studies.registry import BOTH, QUERIES, STUDIES, TRAINING, sections
from lava_vpr.studies.several import as_one, member_seed, shuffled_order, side_by_side, theta_of
from lava_vpr.studies.show.page import costs as drawn_costs, curve, page
from lava_vpr.studies.show.values import as_json, baselines_of, table
from lava_vpr.studies.study import StudyRequest, StudyTask, measure_task, planned, study_rows

PLACES = 8
VALUES: dict[str, tuple[float, ...]] = {
    "places": (4, 8),
    "neurons": (1, 1.5),
    "bits": (2, 3),
    "steps": (64, 128),
    "hyperactive": (4,),
    "ensemble": (1, 2),
}


def route(noise: float = 0.9) -> Route:
    """Eight places and noisy queries of them."""
    return Route((encoded(PLACES),), encoded(PLACES, noise=noise), np.eye(PLACES, dtype=bool))


def asked(name: str) -> StudyRequest:
    return StudyRequest(STUDIES[name], route(), small_config(), (0, 3), VALUES.get(name, ()))


@lru_cache(maxsize=16)
def found(name: str) -> tuple[Row, ...]:
    return study_rows(asked(name))


def page_of(name: str) -> str:
    return page(asked(name), found(name), f"lava-vpr study {name} ref --query query")


def row(name: str, point: str) -> Row:
    (wanted,) = (one for one in found(name) if one.label == point)
    return wanted


@pytest.mark.quick(3)
@pytest.mark.parametrize("name", STUDIES)
def test_a_study_is_the_same_every_time_and_with_other_threads(name: str) -> None:
    first = json.dumps(as_json(asked(name), found(name)), allow_nan=False)
    assert json.dumps(as_json(asked(name), study_rows(asked(name), pool=Pool(3)))) == first
    assert page_of(name) == page_of(name)


@pytest.mark.parametrize("name", STUDIES)
def test_its_tasks_go_to_any_process(name: str) -> None:
    """Outcomes of a task that was packed and unpacked are those of the task itself."""
    task: StudyTask = planned(asked(name))[-1]
    shared = (asked(name).route, STUDIES[name].measure)
    function, there, again = pickle.loads(pickle.dumps((measure_task, shared, task)))
    assert function(there, again) == measure_task(shared, task)


@pytest.mark.parametrize("name", STUDIES)
def test_every_figure_is_a_share_and_stands_in_the_table(name: str) -> None:
    shown = table(asked(name), found(name))
    assert [cells[0] for cells in shown.rows] == [one.label for one in found(name)]
    assert {len(cells) for cells in shown.rows} == {len(shown.columns)}
    for one in found(name):
        assert all(0 <= value <= 1 for spread in one.figures[NETWORK].values() for value in spread.by_seed.values())
        assert set(baselines_of(one)) == {"cosine", "sad"}
        assert list(one.figures[NETWORK]["auc"].by_seed) == [0, 3]
    assert found(name)[0].figures[NETWORK]["recall_at_1"].mean > 1 / PLACES


def costs(one: Row) -> Costs | None:
    """The modelled costs of a row."""
    return Costs(*means(one, MODELLED)) if MODELLED in one.figures else None


def means(one: Row, group: str) -> tuple[float, ...]:
    """The means of some figures of a row."""
    return tuple(value.mean for value in one.figures[group].values())


def auc_of(model: Model, place: Route, noise: int | None = None) -> float:
    """The area under the curve of ``contrast``, from scores to figures without the studies' functions."""
    scores = decode(model, counted(model, place, noise), "contrast")
    return evaluate(scores, confidence("contrast", scores), place.truth).auc


def test_a_point_is_what_eval_says_of_such_a_model() -> None:
    place = route()
    for seed in (0, 3):
        model = learned(place, update(small_config(), {"seed": seed}))
        result = recognise(model, place.queries, place.truth, Comparison(rivals=("cosine", "sad")))
        for study, point, matcher in (("places", "8", "contrast"), ("weighting", "a + b + c", "weighted")):
            by_name = row(study, point).figures[NETWORK]
            assert Recall.of(result.metrics[matcher]) == tuple(by_name[name].by_seed[seed] for name in Recall._fields)
        if seed == 0:
            assert means(row("places", "8"), "sad") == Recall.of(result.metrics["sad"])
            assert costs(row("places", "8")) == modelled(model, place)


def test_bits_and_steps_quantise_anew_what_was_learned_once() -> None:
    place = route()
    model = learned(place, update(small_config(), {"seed": 3}))
    for name, point, made in (
        ("bits", "2", requantised(model, Changes(weight_bits=2))),
        (
            "steps",
            "64",
            requantised(dataclasses.replace(model, config=update(model.config, {"network": {"steps": 64}}))),
        ),
    ):
        assert row(name, point).figures[NETWORK]["auc"].by_seed[3] == auc_of(made, place)
    cheap, dear = costs(row("steps", "64")), costs(row("steps", "128"))
    assert cheap.milliseconds < dear.milliseconds
    assert cheap.microjoules < dear.microjoules


def test_seeds_hold_still_what_they_say() -> None:
    place, configs = route(), {seed: update(small_config(), {"seed": seed}) for seed in (0, 3)}
    both, queries, training = (row("seeds", label) for label in (BOTH, QUERIES, TRAINING))
    for name in Recall._fields:
        assert len({one.figures[NETWORK][name].by_seed[0] for one in (both, queries, training)}) == 1
    for label, model_seed, noise in ((queries, 0, 3), (training, 3, 0), (both, 3, 3)):
        assert label.figures[NETWORK]["auc"].by_seed[3] == auc_of(learned(place, configs[model_seed]), place, noise)


def test_modules_apart_are_models_of_their_own() -> None:
    place, config = route(), update(small_config(), {"seed": 3})
    modules = side_by_side(place, config, 4)
    first = learned(place.section(0, 4), update(config, {"stretch": 0}))
    assert np.array_equal(modules.counts[:, :4], counted(first, place))
    assert np.array_equal(modules.responses[:4, :4], first.responses)
    assert not modules.responses[:4, 4:].any()
    assert modules.neuron_modules.tolist() == modules.place_modules.tolist() == [0] * 4 + [1] * 4
    assert side_by_side(route().section(0, 7), config, 3).place_modules.tolist() == [0] * 3 + [1] * 4


def test_theta_is_that_of_calibration_and_takes_out_what_it_says() -> None:
    config = update(small_config(), {"seed": 3})
    modules = side_by_side(route(), config, 4)
    theta, removed = theta_of(modules, "contrast", 0.02)
    again = row("hyperactive", "modules of 4, apart, without").figures["facts"]
    assert (again["theta_hyper"].by_seed[3], again["removed"].by_seed[3]) == (theta, removed.mean())
    assert np.array_equal(removed, hyperactive((modules.references[4:, :4] > 0).sum(0), theta).tolist() + (
        hyperactive((modules.references[:4, 4:] > 0).sum(0), theta).tolist()
    ))  # fmt: skip


def test_a_neuron_that_fires_everywhere_is_taken_out() -> None:
    """Without it, altered references are recognised better: calibration finds so by itself."""
    config = update(small_config(), {"seed": 3})
    modules = as_one(learned(route(), config), route())
    loud = 1 + int(modules.references.max()) * np.ones((1, 1), np.int32)
    spoilt = modules._replace(
        **{
            name: np.where(np.arange(8) == 2, 3 * loud, getattr(modules, name)).astype(np.int32)
            for name in ("counts", "references", "calibration")
        }
    )
    theta, removed = theta_of(spoilt, "contrast", 0.02)
    assert theta <= 4
    assert removed[2]


def test_an_ensemble_adds_up_its_members() -> None:
    place, config = route(), update(small_config(), {"seed": 3})
    assert member_seed(3, 0) == 3
    total = np.zeros((PLACES, PLACES))
    turned = np.zeros((PLACES, PLACES))
    for member in range(2):
        seeded = update(config, {"seed": member_seed(3, member)})
        model = learned(place, seeded)
        total += decode(model, counted(model, place), "contrast")
        order = shuffled_order(PLACES, seeded.seed) if member else np.arange(PLACES)
        model = learned(place.shuffled(order), seeded)
        scores = decode(model, counted(model, place), "contrast")
        for k, place_k in enumerate(order):
            turned[:, place_k] += scores[:, k]
    for label, scores in (("2 members, other seeds", total), ("2 members, other seeds and orders", turned)):
        figures = evaluate(scores, confidence("contrast", scores), place.truth)
        assert row("ensemble", label).figures[NETWORK]["auc"].by_seed[3] == figures.auc
    one, two = costs(row("ensemble", "1 member")), costs(row("ensemble", "2 members, other seeds"))
    assert two.microjoules > 1.5 * one.microjoules
    assert two.board_microjoules > 1.5 * one.board_microjoules > 15 * one.microjoules


@pytest.mark.parametrize(
    ("places", "number", "expected"),
    [
        (1500, 1500, [(0, 1500)]),
        (1500, 800, [(0, 800), (700, 1500)]),
        (500, 200, [(0, 200), (150, 350), (300, 500)]),
        (300, 100, [(0, 100), (100, 200), (200, 300)]),
        (900, 25, [(k * 125, k * 125 + 25) for k in range(8)]),
    ],
)
def test_sections_hold_the_route_evenly(places: int, number: int, expected: list[tuple[int, int]]) -> None:
    assert sections(places, number) == expected


def test_a_number_of_places_is_the_mean_of_its_sections() -> None:
    place = route()
    for seed in (0, 3):
        figures = []
        for first, end in ((0, 4), (4, 8)):
            part = place.section(first, end)
            figures.append(auc_of(learned(part, update(small_config(), {"seed": seed})), part))
        assert row("places", "4").figures[NETWORK]["auc"].by_seed[seed] == pytest.approx(mean(figures), abs=1e-15)


def test_spread_is_mean_and_sample_deviation() -> None:
    values = {0: 0.25, 1: 0.5, 5: 1.0}
    spread = Spread.of(values)
    assert spread.mean == pytest.approx(mean(values.values()))
    assert spread.deviation == pytest.approx(stdev(values.values()))
    assert Spread.of({4: 0.5}) == Spread(0.5, None, {4: 0.5})


def test_rows_stand_in_the_order_of_their_first_outcome() -> None:
    def outcome(point: str, seed: int, value: float) -> Outcome:
        return Outcome(point, None, seed, {NETWORK: {"auc": value}, "cosine": {"auc": value}})

    made: Sequence[Row] = rows([outcome("b", 0, 0.5), outcome("a", 0, 1.0), outcome("b", 1, 1.0), outcome("b", 0, 1.0)])
    assert [one.label for one in made] == ["b", "a"]
    assert made[0].figures[NETWORK]["auc"].by_seed == {0: 0.75, 1: 1.0}
    assert made[0].mean("cosine", "auc") == 0.875
    assert made[0].mean("sad", "auc") is None


REFUSED = [
    ("weighting", (1,), "the study weighting takes no --values"),
    ("bits", (2.5,), "--values: 2.5 is no whole number, as the study bits takes"),
    ("bits", (9,), "network.weight_bits is 9"),
    ("steps", (100,), "network.steps is 100"),
    ("places", (9,), "--values: 9 places, but there are images of 2 to 8"),
    ("hyperactive", (8,), "modules of 8 places, but the route has 8"),
    ("neurons", (1000,), "network.neurons_per_place is 1000"),
]


@pytest.mark.parametrize(("name", "values", "said"), REFUSED)
def test_points_that_cannot_be_are_refused_before_any_work(name: str, values: tuple[float, ...], said: str) -> None:
    done: list[int] = []
    with pytest.raises(ConfigError, match=said):
        study_rows(dataclasses.replace(asked(name), values=values), advance=lambda k, note: done.append(k))
    assert done == []


@pytest.mark.parametrize("name", ["bits", "steps", "hyperactive", "ensemble"])
def test_what_needs_integers_refuses_the_float_model(name: str) -> None:
    inputs = tiny_paper().encoder.inputs
    place = Route((encoded(PLACES, inputs),), encoded(PLACES, inputs), np.eye(PLACES, dtype=bool))
    with pytest.raises(ConfigError, match=f"the study {name} needs an integer network"):
        study_rows(StudyRequest(STUDIES[name], place, tiny_paper(), (0,), VALUES[name]))


def test_a_board_that_cannot_run_a_network_leaves_a_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    known = found("bits")[0]  # on a board that can
    monkeypatch.setattr(measuring, "BOARD", dataclasses.replace(KAPOHO_BAY, memory=PackedRows(4), cores=1, chips=1))
    bits = StudyRequest(STUDIES["bits"], route(), small_config(), (0,), (2, 3))
    made = study_rows(bits)
    assert [costs(one) for one in made] == [None, None]
    assert as_json(bits, made)["points"][1]["modelled"] is None
    assert "board uJ, modelled" not in table(bits, made).columns
    assert as_json(bits, made)["points"][0]["network"]["auc"]["deviation"] is None
    assert table(bits, (known, made[1])).rows[1][-2:] == ("-", "-")


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["steps", "weighting"])
def test_a_browser_has_nothing_to_say_of_the_page(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    target = tmp_path_factory.mktemp("page") / "study.html"
    target.write_text(page_of(name))
    seen = visit(target)
    assert seen.console == ()
    assert STUDIES[name].title in seen.dom


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["bits", "hyperactive"])
def test_on_a_phone_nothing_sticks_out_and_words_can_be_read(name: str, tmp_path: Path) -> None:
    seen = on_phone(page_of(name), tmp_path)
    assert seen.wide <= PHONE
    assert seen.said == STUDIES[name].title
    assert seen.smallest >= 7


QUICK = ("--config", "quick.toml", "--seeds", "0,1")


def study(*words: object) -> str:
    return commands.run("study", *words, *QUICK).stdout


@pytest.mark.slow
def test_a_cluster_gives_the_bytes_of_this_machine(here: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    words = ("hyperactive", "reference", "--query", "query", "--values", "4")
    with DaskCluster(tmp_path_factory.mktemp("cluster")) as cluster:
        there = study(*words, "--cluster", cluster.address, "--json", "there.json", "--report", "there")
    alone = study(*words, "--json", "here.json", "--report", "here")
    assert alone == there.replace("report: there", "report: here")
    assert Path("there.json").read_bytes() == Path("here.json").read_bytes()
    assert Path("there/study.html").read_bytes() == Path("here/study.html").read_bytes()


def test_places_take_a_part_of_each_traverse(here: Path) -> None:
    order = listed("part.txt", images("reference")[2:6])
    asked = listed("asked.txt", images("query")[2:6])
    whole = study("seeds", "reference", "--query", "query", "--places", "2:6", "--json", "a.json")
    study("seeds", order, "--query", asked, "--json", "b.json")
    assert Path("a.json").read_bytes() == Path("b.json").read_bytes()
    assert "4 queries, 4 places" in whole


@pytest.mark.parametrize("draw", [curve, drawn_costs])
@pytest.mark.parametrize("recall", [(1.0, 1.0), (0.62, 1.0), (0.97, 0.99)])
def test_no_axis_of_recall_goes_on_beyond_all(draw: Callable[..., str], recall: tuple[float, ...]) -> None:
    found = rows(
        Outcome(
            f"{k}",
            k,
            0,
            {NETWORK: dict.fromkeys(Recall._fields, value), MODELLED: Costs(k, k / 8, k / 16)._asdict()},
        )
        for k, value in enumerate(recall, start=2)
    )
    ticks = [float(text) for text in re.findall(r">(\d+(?:\.\d+)?)<", draw(found, "bits", "label"))]
    assert max(ticks) == 100
    assert sum(tick <= 100 for tick in ticks if tick >= 90) >= 2
