"""``lava-vpr bench``: recall beside costs, what is absent and why, what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from support.common.commands import PLACES, fails, run

from lava_vpr import model as model_file
from lava_vpr.backends.registry import timed_by_default
from lava_vpr.bench import run as stages
from lava_vpr.bench.measure import timing
from lava_vpr.bench.results import Measured, Peer, SweepPoint
from lava_vpr.encoding import encode_traverse
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ConfigError
from lava_vpr.recognition import count_query_spikes
from lava_vpr.traverse import open_traverse

BENCH = ("bench", "m.lvpr", "query")


@pytest.fixture
def quick(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Nothing is timed."""

    def measure(queries: Any, name: str, **_: Any) -> Measured:
        return Measured(name, "made up", len(queries), 2, 1000.0, (0.5, 1.0, 2.0), 10**8, no_energy="no counters")

    monkeypatch.setattr(stages, "measure", measure)
    return here


def written(*words: object) -> tuple[dict[str, Any], str]:
    """JSON and terminal text of a run."""
    text = run(*BENCH, *words, "--json", "b.json").stdout
    return json.loads(Path("b.json").read_text()), text


def test_a_spiking_front_end_is_counted_for_each_board(quick: Path) -> None:
    run("train", "reference", "-o", "f.lvpr", "--input", "frontend", "--preset", "fast", "--learning", "template")
    text = run("bench", "f.lvpr", "query", "--target", "kapoho-bay", "--json", "b.json").stdout
    (found,) = json.loads(Path("b.json").read_text())["front_end"].values()
    layers = found["layers"]
    assert (found["images"], found["steps"], found["cores"]) == (PLACES, 29, 45)
    assert layers["pixels"]["spikes"] == 2048
    assert layers["filters"]["accesses"] == 29 * 16384
    assert 0 < layers["pairs"]["spikes"] < layers["filters"]["spikes"]
    assert found["dynamic_microjoules"]["filters"]["nominal"] > found["dynamic_microjoules"]["pairs"]["nominal"] > 24
    assert found["milliseconds"]["nominal"] < found["between_milliseconds"]["clearing of states"]["nominal"]
    assert "spiking front end on Kapoho Bay (two Loihi 1 chips): counted, a presentation of 29 steps, 45 cores" in text
    assert "registers: clearing of states" in text
    run(*BENCH, "--target", "kapoho-bay", "--json", "b.json")
    assert "front_end" not in json.loads(Path("b.json").read_text())
    text = " ".join(run("fit", "f.lvpr", "--target", "kapoho-bay", "--json", "f.json").stdout.split())
    fitted = json.loads(Path("f.json").read_text())["front_end"]
    assert (fitted["fits"], fitted["cores"], fitted["steps"]) == (True, 45, 29)
    assert fitted["populations"]["filters"]["binds"] == "compartments"
    assert "It fits beside the network's 1 of 256 cores. No board's program runs it (unproven)" in text
    text = " ".join(run("fit", "f.lvpr", "--target", "loihi2").stdout.split())
    assert "Whether it fits is unknown" in text
    assert "No bundle holds it: a bundle for Loihi 2 has no files for it." in text
    assert "Its 29 steps would be 32: neurons are reset at powers of two." in text
    text = " ".join(run("deploy", "f.lvpr", "--target", "kapoho-bay", "-o", "fb").stdout.split())
    assert "The spiking front end stands on 45 cores more, which lava-vpr's --backend bundle simulates" in text
    read = " ".join(Path("fb/README.md").read_text().split())
    assert "The spiking front end stands on 45 cores more" in read
    facts = json.loads(Path("fb/manifest.json").read_text())["front_end"]
    assert (facts["steps"], facts["cores"], len(list(Path("fb/front_end/cores").iterdir()))) == (29, 45, 45)
    assert "`front_end/cores/`" in read
    text = " ".join(run("deploy", "f.lvpr", "--target", "loihi2", "-o", "lb").stdout.split())
    why = "The bundle holds no spiking front end: a bundle for Loihi 2 has no files for it."
    read = " ".join(Path("lb/README.md").read_text().split())
    assert why in text
    assert why in read
    assert "front_end/cores" not in read
    assert not Path("lb/front_end").exists()


def test_fit_deploy_and_bench_model_one_time_of_a_bundle(quick: Path) -> None:
    """Asked are the reference images, which is what `fit` and `deploy` say theirs rests on."""
    fitted = run("fit", "m.lvpr", "--target", "kapoho-bay", "--json", "f.json").stdout
    deployed = run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "b", "--json", "d.json").stdout
    benched = run("bench", "b", "reference", "--target", "kapoho-bay", "--json", "b.json").stdout
    times = json.loads(Path("b.json").read_text())["modelled"]["kapoho-bay"]
    number, some = r"([\d.,]+)", r"([\d.,]+) (?:ms|µs) \(([\d.,]+) to ([\d.,]+)\)"
    asked = f"its {PLACES} reference images, asked as queries"
    sentence = f"Modelled on {asked}: {some} a query of 256 steps, {some} a step, {number} µs of it on the busiest core"
    said = [re.search(sentence, " ".join(text.split())) for text in (deployed, Path("b/README.md").read_text())]
    said.append(re.search(f"A query of its references is modelled to take {some}, a step {some};", fitted))
    rows = ("time on the chip, ms", "one step, us")
    cells = [re.search(rf"│ +{row} +│ +{number} │ +{number} │ +{number} │", benched) for row in rows]
    low, nominal, high, *of_step = [cell for row in cells if row is not None for cell in row.groups()]
    wanted = (nominal, low, high, of_step[1], of_step[0], of_step[2])
    assert [found.groups()[:6] for found in said if found is not None] == [wanted] * 3
    written = [json.loads(Path(name).read_text()) for name in ("f.json", "d.json", "b/manifest.json")]
    for found in (one["modelled"] for one in written):
        assert found["activity"] == asked
        assert {name: times[name] for name in ("step_microseconds", "milliseconds")}.items() <= found.items()
    (core,) = json.loads(Path("b/mapping.json").read_text())["cores"]
    embedded = times["embedded"]["step_microseconds"]["nominal"]
    assert 0 < core["load"]["nanoseconds"] / 1e3 < times["step_microseconds"]["nominal"] - embedded


# --- what is told ----------------------------------------------------------------------------------------------------


def test_counts_and_recall_are_those_of_the_run(quick: Path) -> None:
    values, text = written("--seed", 7)
    run("eval", "m.lvpr", "query", "--seed", 7, "--json", "e.json")
    figures = json.loads(Path("e.json").read_text())
    assert values["recall"] == figures["decoders"][figures["default_decoder"]]
    model = model_file.load("m.lvpr")
    assert isinstance(model.network, FixedNetwork)
    counts = values["counts"]
    assert counts["steps"] == model.network.interval
    assert counts == values["modelled"]["kapoho-bay"]["counts"]
    # The engine counts inputs and spikes by itself, without a mapping.
    queries = encode_traverse(open_traverse("query"), model.config.encoder)
    spikes, events = count_query_spikes(model, queries, seed=7)
    assert counts["exc_spikes"] == pytest.approx(spikes.sum() / len(queries))
    assert counts["input_spikes"] == pytest.approx(events["input_spikes"] / len(queries))
    assert counts["exc_spikes"] > 1
    # A dense row also meets the weights that are 0.
    assert counts["synaptic_operations"] >= events["synaptic_operations"] / len(queries)
    parts = ("R@1", "energy of a query, all of it", "measured here", "modelled for Kapoho Bay")
    order = [text.index(part) for part in parts]
    assert order == sorted(order)


def test_the_whole_energy_leads(quick: Path) -> None:
    values, _ = written("--report", "r")
    run("eval", "m.lvpr", "query", "--json", "e.json")
    figures = json.loads(Path("e.json").read_text())
    ways, costs = values["energy"], values["modelled"]["kapoho-bay"]
    assert list(ways) == ["kapoho-bay", "host", "cosine"]  # of Loihi 2 no energies are public
    board = ways["kapoho-bay"]
    assert board["dynamic_microjoules"] == costs["dynamic_microjoules"]
    for level in ("low", "nominal", "high"):
        assert board["static_microjoules"][level] == pytest.approx(1e3 * costs["static_millijoules"][level])
        static = board["static_microjoules"][level] + board["io_static_microjoules"][level]
        assert static == pytest.approx(1e3 * costs["wall_static_millijoules"][level])
    assert board["recall_at_1"] == ways["host"]["recall_at_1"] == values["recall"]["recall_at_1"]
    assert ways["cosine"]["recall_at_1"] == figures["baselines"]["cosine"]["recall_at_1"]
    assert ways["host"]["work_milliseconds"] == 1.0  # the median of what was made up
    encoding = values["measured"]["encoding"]["milliseconds_per_query"]["p50"]
    assert {way["encoding_milliseconds"] for way in ways.values()} == {encoding}
    power = values["constants"]["host_power"]
    for way in ways.values():
        for level in ("low", "nominal", "high"):
            assert way["work_microjoules"][level] == pytest.approx(power[level] * way["work_milliseconds"])
    text = Path("r/bench.html").read_text()
    assert text.index('<section id="energy"') < text.index('<section id="modelled"')
    values, _ = written("--backend", "bundle", "--target", "loihi2")
    assert list(values["energy"]) == ["cosine"]


def test_the_energy_of_an_adapted_query_has_the_product_and_the_biases(quick: Path) -> None:
    values, text = written("--adapt", 4)
    ways, asked = values["energy"], values["asked"]
    assert list(ways) == ["kapoho-bay", "host", "kapoho-bay, adapted", "host, adapted", "cosine"]
    for name in ("kapoho-bay", "host"):
        plain, adapted = ways[name], ways[f"{name}, adapted"]
        more = adapted["work_milliseconds"] - plain["work_milliseconds"]
        assert more == pytest.approx(asked["host_milliseconds"])
        assert adapted["recall_at_1"] == asked["adapted"]["recall_at_1"]
    once, board = ways["kapoho-bay"], ways["kapoho-bay, adapted"]
    clearing = values["modelled"]["kapoho-bay"]["clearing"]["microjoules"]["nominal"]  # of two registers a neuron
    sent = board["dynamic_microjoules"]["nominal"] - once["dynamic_microjoules"]["nominal"]
    assert sent == pytest.approx(clearing / 2)
    assert board["io_static_microjoules"]["nominal"] > once["io_static_microjoules"]["nominal"]
    assert re.search(r"│ Kapoho Bay, adapted, partly modelled │ +[\d.]+ │", text), text
    assert re.search(r"│ this network, no board, adapted +│ +[\d.]+ │", text), text


def test_views_and_adaptation_have_rows_and_costs_of_their_own(quick: Path) -> None:
    how = ("--query-views", 3, "--adapt", 4)
    plain, told = written()
    assert plain["asked"] is None
    values, text = written(*how)
    asked = values["asked"]
    run("eval", "m.lvpr", "query", *how, "--json", "e.json")
    figures = json.loads(Path("e.json").read_text())
    assert asked["recall"] == figures["decoders"]["contrast"]
    assert asked["adapted"] == figures["adapted"]["contrast"]
    assert (asked["views"], asked["adapt"]) == (3, 4.0)
    network = model_file.load("m.lvpr").network
    assert isinstance(network, FixedNetwork)
    assert asked["multiply_adds"] == network.weights.size
    assert asked["host_milliseconds"] > 0
    assert asked["events"]["steps"] == 3 * network.interval
    board, once = asked["boards"]["kapoho-bay"], plain["modelled"]["kapoho-bay"]
    assert (board["presentations"], board["steps"]) == (3, 3 * network.interval)
    # Before each presentation: a membrane, a counter and a bias of every neuron.
    assert board["registers"] == 3 * 3 * PLACES
    for name in ("dynamic_microjoules", "milliseconds", "io_milliseconds"):
        assert 2.5 * once[name]["nominal"] < board[name]["nominal"] < 5 * once[name]["nominal"], name
    other = asked["boards"]["loihi2"]
    assert (other["registers"], other["dynamic_microjoules"]) == (3 * PLACES, None)
    assert "contrast, in 3 views, adapted" in text
    assert "adapted over 4 queries" in text
    assert "adapted" not in told
    # Everything else is of queries that are presented once.
    assert values["modelled"] == plain["modelled"]
    assert values["recall"] == plain["recall"]


def test_boards_without_published_figures_are_counted_only(quick: Path) -> None:
    values, text = written()
    second = values["modelled"]["loihi2"]
    assert second["dynamic_microjoules"] is second["milliseconds"] is second["static_millijoules"] is None
    assert second["counts"]["synaptic_operations"] > 0
    assert second["counts"]["hops"] is None
    assert "absent: loihi2, modelled energy and time: no energy" in text
    assert "cross-check" not in text
    assert "absent: energy of host, lava-fixed, lava-fused, bundle, measured: no counters" in text
    assert "absent: peers: not asked for" in text
    first = values["modelled"]["kapoho-bay"]
    assert first["chips"] == 2
    assert first["clearing"]["writes_per_query"] == 2 * PLACES  # a membrane and a counter of every neuron
    assert 0 < first["dynamic_microjoules"]["low"] < first["dynamic_microjoules"]["nominal"] < 10
    assert all(one["source"] for one in values["constants"].values())


def test_what_is_modelled_repeats_to_the_byte(quick: Path) -> None:
    first, text = written("--target", "kapoho-bay", "--report", "r")
    page = Path("r/bench.html").read_bytes()
    assert text.endswith("report: r/bench.html\n")
    before = Path("b.json").read_bytes()
    timed = re.compile(rb'"(?:encoding|localizer)": .*?"board"|"energy": .*?"measured"', re.DOTALL)
    second, _ = written("--target", "kapoho-bay")
    assert timed.sub(b"", Path("b.json").read_bytes()) == timed.sub(b"", before)
    assert list(first["modelled"]) == ["kapoho-bay"] == list(second["modelled"])
    assert b"<script" not in page
    assert first["command"] == "lava-vpr bench m.lvpr query --target kapoho-bay"
    assert str(Path.cwd()).encode() not in page + before


def test_a_bundle_costs_what_its_model_does(quick: Path) -> None:
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "b")
    run("bench", "b", "query", "--target", "kapoho-bay", "--json", "c.json")
    values, _ = written("--target", "kapoho-bay")
    found = json.loads(Path("c.json").read_text())
    assert found["modelled"] == values["modelled"]
    assert found["recall"] == values["recall"]
    assert "b: --sweep: a bundle has no float weights" in fails("bench", "b", "query", "--sweep")


def test_some_queries_stand_for_many(quick: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stages, "COUNTED", 3)
    values, _ = written("--target", "kapoho-bay")
    assert "Counted on 3 of the 8 queries, evenly spread." in values["assumptions"]


def test_what_was_asked_for_and_fails_is_said(quick: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> tuple[SweepPoint, ...]:
        raise ConfigError("nothing that was tried fits")

    called = []

    def peers(queries: Any, known: Any) -> tuple[Peer, ...]:
        called.append(known)
        return (Peer("sad", "the baseline", known.metrics["sad"], 5000.0, 2, 6272, 8),)

    monkeypatch.setattr(stages, "sweep", broken)
    monkeypatch.setattr(stages, "run_peers", peers)
    values, text = written("--sweep", "--peers")
    assert values["sweep"] is None
    assert "absent: sweep: nothing that was tried fits" in text
    assert values["peers"]["sad"]["queries_per_second"] == 5000
    assert {"sad", "cosine"} <= set(called[0].metrics)
    assert values["command"] == "lava-vpr bench m.lvpr query --sweep --peers"


def test_a_network_that_does_not_fit_is_told_unless_it_was_asked_for(quick: Path) -> None:
    Path("many.toml").write_text("[encoder]\nquery_spikes = 60.0\n[learning]\nepochs = 1\n")
    run("train", "reference", "-o", "many.lvpr", "--config", "many.toml")
    text = run("bench", "many.lvpr", "query", "--json", "b.json").stdout
    values = json.loads(Path("b.json").read_text())
    board = values["modelled"]["kapoho-bay"]
    assert board["dynamic_microjoules"] is None
    assert "input spikes a step" in board["unavailable"]
    assert values["counts"] == values["modelled"]["loihi2"]["counts"]
    assert "absent: kapoho-bay, modelled energy and time" in text
    assert "input spikes a step" in fails("bench", "many.lvpr", "query", "--target", "kapoho-bay")


def test_a_float_model_has_recall_and_nothing_modelled(quick: Path) -> None:
    Path("p.toml").write_text(
        "[network]\nneurons = 12\nsteps = 600\nrest_steps = 60\n[learning]\nepochs = 1\nlabel_epochs = 1\n"
    )
    run("train", "reference", "-o", "p.lvpr", "--preset", "paper", "--config", "p.toml")
    text = run("bench", "p.lvpr", "query", "--json", "b.json", "--report", "r").stdout
    values = json.loads(Path("b.json").read_text())
    assert values["recall"]["recall_at_1"] is not None
    assert list(values["energy"]) == ["host", "cosine"]
    assert values["workload"] is None
    for one in values["modelled"].values():
        assert one["dynamic_microjoules"] is None
        assert "needs an integer network" in one["unavailable"]
    assert values["counts"]["input_spikes"] > 0
    assert values["counts"]["hops"] is None
    assert "absent: workload metrics" in text
    for command in (("bench", "p.lvpr", "query"), ("fit", "p.lvpr"), ("deploy", "p.lvpr", "-o", "out")):
        told = fails(*command, "--target", "loihi2")
        assert told.startswith("p.lvpr: Loihi 2 needs an integer network, but preset paper")
    assert "--sweep" in fails("bench", "p.lvpr", "query", "--sweep")


# --- really ----------------------------------------------------------------------------------------------------------


def test_the_host_is_timed(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is replaced, but fewer rounds."""
    measure = stages.measure
    monkeypatch.setattr(timing, "SINGLES", 50)
    monkeypatch.setattr(stages, "measure", lambda *a, **k: measure(*a, **k, rounds=1))
    values, text = written("--backend", "host", "--limit", 4, "--target", "kapoho-bay")
    host = values["measured"]["host"]
    assert host["absent"] is None
    assert host["queries"] == 4
    assert host["queries_per_second"] > 50
    latency = host["milliseconds_per_query"]
    assert 0 < latency["p50"] <= latency["p95"] <= latency["p99"] < 1000
    assert list(values["measured"]) == ["encoding", "localizer", "host"]
    assert re.search(r"│ host +│ +[\d.]+ │ +[\d.]+ │ +[\d.,]+ │", text), text


@pytest.mark.lava
@pytest.mark.slow
def test_every_backend_is_timed(here: Path) -> None:
    values, _ = written("--limit", 4, "--peers", "--report", "r")
    for name in timed_by_default():
        assert values["measured"][name]["absent"] is None, name
        assert values["measured"][name]["milliseconds_per_query"]["p50"] > 0
    assert list(values["peers"]) == ["lava-vpr", "sad", "cosine", "hog", "template"]
    assert all(one["queries_per_second"] > 0 for one in values["peers"].values())


def test_positions_bring_a_map(quick: Path) -> None:
    run("train", "reference", "-o", "p.lvpr", "--config", "quick.toml", "--positions", "reference_positions.csv")
    words = ("p.lvpr", "query", "--query-positions", "query_positions.csv")
    run("bench", *words, "--json", "b.json", "--report", "r")
    run("eval", *words, "--json", "e.json")
    values, figures = (json.loads(Path(name).read_text()) for name in ("b.json", "e.json"))
    assert values["position_error"] == figures["position_error"]
    assert values["recall"] == figures["decoders"]["contrast"]
    assert values["probability"]["single"] == figures["probability"]["single"]
    text = Path("r/bench.html").read_text()
    assert '<section id="map">' in text
    assert '<section id="trust">' in text
    assert "thresholds and workload metrics: --report DIR or --json FILE" in run(*BENCH).stdout
