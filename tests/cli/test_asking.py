"""Views of references and queries, and adaptation, from the command line: neurons, answers, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.common.commands import PLACES, fails, figures, matches, run

from lava_vpr import model as model_file
from lava_vpr.backends import answering
from lava_vpr.backends.asking import Asker, Asking, adapted_scores
from lava_vpr.backends.interface import HostBackend
from lava_vpr.encoding import encode_traverse, encode_views
from lava_vpr.engine.adaptation import Adaptation
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.model import Model, decode
from lava_vpr.storage import container
from lava_vpr.traverse import open_traverse


def answered(*words: object) -> list[tuple[str, str]]:
    """Place and confidence of every query."""
    return [(row["place"], row["confidence"]) for row in matches(*words)]


def literal(model: Model, asking: Asking, source: str = "query") -> list[tuple[str, str]]:
    """`answered` by the words of the definition, one presentation after another."""
    assert isinstance(model.network, FixedNetwork)
    views = encode_views(open_traverse(source), model.config.encoder, asking.of(model))
    shown = [Asker(model).presentations((view,)) for view in views]
    adaptation = Adaptation(model.network, asking.adapt) if asking.adapt else None
    rows = []
    for i in range(len(views[0])):
        total = np.zeros((1, model.neurons), np.int32)
        bias = adaptation.biases(shown[0].rates[i : i + 1]) if adaptation else model.network.bias[None]
        for view in shown:
            one = type(view)(view.rates[i : i + 1], view.seed, bias=bias)
            total += HostBackend().count_spikes(model, one)[0]
        scores = decode(model, total, "contrast")[0]
        best = int(scores.argmax())
        first, second = np.sort(scores)[::-1][:2]
        rows.append((str(model.place_indices[best]), repr(float((first - second) / np.sqrt(first + second + 1.0)))))
    return rows


@pytest.mark.parametrize("asking", [Asking(views=3), Asking(adapt=4.0), Asking(views=3, adapt=4.0)])
def test_queries_are_answered_as_they_are_asked(here: Path, monkeypatch: pytest.MonkeyPatch, asking: Asking) -> None:
    monkeypatch.setattr(answering, "BATCH", 3)
    words = ["--query-views", asking.views] + (["--adapt", asking.adapt] if asking.adapt else [])
    model = model_file.load(Path("m.lvpr"))
    told = answered("query", *words)
    assert told == literal(model, asking)
    assert told != answered("query")


@pytest.mark.lava
@pytest.mark.parametrize("backend", ["bundle", "lava-fused"])
def test_backends_answer_alike_however_queries_are_asked(here: Path, backend: str) -> None:
    words = ["query", "--query-views", 3, "--adapt", 4]
    told = answered(*words)
    assert answered(*words, "--backend", backend) == told
    assert told != answered("query", "--query-views", 3)


def test_verify_compares_every_spike_however_queries_are_asked(here: Path) -> None:
    words = ["verify", "m.lvpr", "query", "--limit", 3, "--json", "v.json", "--backend", "bundle"]
    seen = {}
    for how in ((), ("--query-views", 3, "--adapt", 2)):
        assert "Queries: the first 3 of 8 images; --limit N takes more." in run(*words, *how).stdout
        seen[how] = json.loads(Path("v.json").read_text())["backends"]["bundle"]
        assert seen[how]["equal"] is True
        assert seen[how]["queries"] == 3
    plain, asked = (told["spikes_compared"] for told in seen.values())
    assert asked > 2 * plain  # every view is
    assert "Queries: the first" not in run(*words, "--limit", 8).stdout


def test_eval_shows_adapted_figures_in_rows_of_their_own(here: Path) -> None:
    plain, adapted = figures("query", "--motion", "none"), figures("query", "--motion", "none", "--adapt", 5)
    assert plain["adapted"] == {}
    assert {**adapted, "adapted": {}, "curves": {**adapted["curves"], "adapted": {}}} == plain
    assert set(adapted["adapted"]) == {"contrast", "sad", "cosine", "hog", "template"}
    table = run("eval", "m.lvpr", "query", "--adapt", 5).stdout
    assert "contrast, adapted" in table
    assert "cosine, adapted" in table


@pytest.mark.parametrize(
    ("words", "same"),
    [
        (("--motion", "any"), ("--motion", "any", "--adapt", 30)),
        (("--motion", "none"), ("--motion", "none", "--adapt", "off")),
        (("--sequence", 2), ("--sequence", 2, "--adapt", "off")),
        (("--motion", "any", "--query-views", 3), ("--motion", "any", "--query-views", 3, "--adapt", 30)),
    ],
)
def test_who_tracks_a_robot_adapts_as_the_model_says(
    here: Path, words: tuple[object, ...], same: tuple[object, ...]
) -> None:
    asked = [matches("query", *words, *more) for more in ((), ("--adapt", "off"))]
    assert asked[0] == matches("query", *same)
    assert (asked[0] == asked[1]) == ("any" not in words)


@pytest.mark.parametrize("given", ["0", "foo", "nan"])
def test_what_is_no_time_constant_is_refused_with_what_is_one(given: str) -> None:
    told = " ".join(fails("query", "m.lvpr", "query", "--adapt", given, code=2).split())
    assert told.endswith("; give a number of queries, at least 1, or off")


def test_a_filter_in_eval_is_of_queries_as_query_asks_them(here: Path) -> None:
    header, arrays = container.load(Path("m.lvpr"), "model")
    header["config"]["network"]["adapt"] = 2
    Path("m.lvpr").unlink()  # a link
    container.save(Path("m.lvpr"), "model", header, arrays)
    told = {how: figures("query", *how) for how in ((), ("--adapt", 2), ("--adapt", "off"))}
    chances = {how: values["curves"]["followed"]["filtered"]["threshold"] for how, values in told.items()}
    for how, thresholds in chances.items():
        rows = matches("query", "--motion", "any", *how)
        assert thresholds[1:] == pytest.approx(sorted({float(row["probability"]) for row in rows})[::-1], abs=1e-6)
    assert chances[()] == chances["--adapt", 2] != chances["--adapt", "off"]
    assert told[()]["adapted"] == {} != told["--adapt", 2]["adapted"]


def test_baselines_adapt_as_neurons_do() -> None:
    rng = np.random.default_rng(0)
    scores, start = rng.random((6, 3)), rng.random(3)
    rates = (rng.integers(0, 1000, (6, 50)) * (rng.random((6, 50)) < 0.2)).astype(np.uint16)
    mean, expected = start.copy(), []
    for row in scores:
        expected.append(row - mean)
        mean = mean + (row - mean) / 5.0
    adapted = adapted_scores(scores, start, rates, 5.0)
    assert np.allclose(adapted - adapted.min(), np.array(expected) - np.min(expected))
    assert (adapted > 0).all()


def test_every_view_of_a_place_has_neurons_of_its_own(here: Path) -> None:
    run("train", "reference", "--views", 3, "-o", "views.lvpr", "--config", "quick.toml", "--stretch", 5)
    model = model_file.load(Path("views.lvpr"))
    assert model.config.views.shifts == 3
    assert (model.places, model.neurons) == (PLACES, 3 * PLACES)
    assert [(s.first_place, s.places, s.first_neuron, s.view) for s in model.stretches] == [
        (4 * (k % 2), 4, 4 * k, k // 2) for k in range(6)
    ]
    assert len(model.labels) == 3 * PLACES
    for k, seen in enumerate(encode_views(open_traverse("reference"), model.config.encoder, model.config.views.views)):
        assert np.array_equal(model.activity[k * PLACES : (k + 1) * PLACES], seen.activity)
    # Each view is recognised by neurons that learned it.
    counts, _ = HostBackend().count_spikes(
        model, Asker(model).presentations((encode_traverse(open_traverse("reference"), model.config.encoder),))
    )
    views = counts.reshape(PLACES, 3, PLACES).sum(axis=(0, 2))
    assert views.argmax() == 0
    assert figures("query")["places"] == PLACES


def test_templates_of_views_are_the_views(here: Path) -> None:
    run("train", "reference", "--views", 3, "--learning", "template", "-o", "t.lvpr", "--config", "quick.toml")
    model = model_file.load(Path("t.lvpr"))
    shares = model.activity / model.activity.sum(axis=1, keepdims=True)
    cosines = (shares @ model.learned) / np.linalg.norm(shares, axis=1)[:, None] / np.linalg.norm(model.learned, axis=0)
    assert np.diag(cosines).min() > 0.9999


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (("query", "m.lvpr", "query", "-o", "q.csv", "--query-views", 2), "views.shifts is 2, but must be odd"),
        (("eval", "m.lvpr", "query", "--query-views", 98), "views.shifts is 98, but must be odd"),
        (("train", "reference", "-o", "x.lvpr", "--views", 4), "views.shifts is 4, but must be odd"),
        (("train", "reference", "-o", "x.lvpr", "--views", 3, "--preset", "paper"), "learns one view"),
        (("eval", "plain.lvpr", "query", "--adapt", 5), "needs neurons with biases"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(here: Path, words: tuple[object, ...], cause: str) -> None:
    if "plain.lvpr" in words:
        Path("plain.toml").write_text(Path("quick.toml").read_text().replace("[network]", "[network]\nsigned = false"))
        run("train", "reference", "-o", "plain.lvpr", "--config", "plain.toml")
    assert cause in fails(*words)


def test_a_file_with_other_views_than_its_settings_is_refused(here: Path) -> None:
    run("train", "reference", "--views", 3, "-o", "views.lvpr", "--config", "quick.toml")
    model = model_file.load(Path("views.lvpr"))
    header, arrays = model_file.content(model)
    for change in (
        {"stretches": [[*row[:4], 0] for row in header["stretches"]]},
        {"stretches": header["stretches"][:2]},
        {"config": {**header["config"], "views": {**header["config"]["views"], "shifts": 5}}},
    ):
        wrong = json.loads(json.dumps(header | change))
        with pytest.raises(Exception, match="stretch"):
            model_file.assemble(Path("views.lvpr"), wrong, arrays)
    assert model_file.assemble(Path("views.lvpr"), json.loads(json.dumps(header)), arrays).stretches == model.stretches


def test_rows_of_a_table_keep_their_order_when_it_adapts(here: Path) -> None:
    assert [int(row["query"]) for row in matches("query", "--adapt", 4)] == list(range(PLACES))
