"""`lava-vpr verify`: the same spikes on every backend, and what is said when they are not."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from support.common.commands import PLACES, SHORT, figures, run
from support.common.small_models import encoded, small_model, tiny_paper

from benchmarks.places import SECTIONS, TEMPLATES, encoded as real, images_of, learn
from lava_vpr import model as model_file
from lava_vpr.backends import comparing, lava, registry as backends
from lava_vpr.backends.comparing import compare
from lava_vpr.backends.interface import HostBackend, Presentations, query_presentations
from lava_vpr.backends.verification import Verdict, verify
from lava_vpr.cli import main
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.encoding import encode_arrays, encode_traverse
from lava_vpr.engine.presentations import Trains
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.inputs.encoder import Keep
from lava_vpr.inputs.front_end_settings import FRONT_END
from lava_vpr.model import Model, integer_model
from lava_vpr.processes.base import lava_checks
from lava_vpr.recognition import DECODERS_ONLY, recognise
from lava_vpr.synthetic.world import World, render
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

FIXED = ("lava-fixed", "lava-fused", "lava-library")


def trains() -> Trains:
    rng = np.random.default_rng(0)
    exc, inh, inputs = ((rng.random((2, 9, width)) < 0.3).astype(np.uint8) for width in (5, 5, 20))
    return Trains(exc, inputs, inh)


def test_every_spike_is_compared() -> None:
    host = trains()
    spikes, differing, mismatch = compare(host.films, host.films, ("a", "b"))
    assert spikes == {"inputs": host.inputs.sum(), "exc": host.exc.sum(), "inh": host.inh.sum()}
    assert (differing, mismatch) == (0, None)
    only = Trains(host.exc)
    assert compare(host.films, only.films, ("a", "b"))[0] == {"exc": host.exc.sum()}


@pytest.mark.parametrize("population", Trains.POPULATIONS)
def test_one_spike_too_many_or_too_few_is_found(population: str) -> None:
    host = trains()
    changed = getattr(host, population).copy()
    changed[1, 4, 3] ^= 1
    _, differing, mismatch = compare(host.films, replace(host, **{population: changed}).films, ("a", "b"))
    assert differing == 1
    was = int(getattr(host, population)[1, 4, 3])
    assert str(mismatch) == (f"query b, step 4, population {population}, neuron 3: host {was}, backend {1 - was}")


def test_the_first_mismatch_is_the_earliest_step() -> None:
    host = trains()
    inputs, inh = host.inputs.copy(), host.inh.copy()  # type: ignore[union-attr]
    inputs[0, 7, 0] ^= 1
    inh[0, 5, 2] ^= 1
    _, differing, mismatch = compare(host.films, replace(host, inputs=inputs, inh=inh).films, ("a", "b"))
    assert differing == 2
    assert (mismatch.population, mismatch.step) == ("inh", 5)


def test_trains_of_another_shape_are_refused() -> None:
    host = trains()
    with pytest.raises(InputError, match=r"^exc trains of shape \(2, 8, 5\) instead of \(2, 9, 5\); the backend runs"):
        compare(host.films, replace(host, exc=host.exc[:, 1:]).films, ("a", "b"))


def test_a_query_without_spikes_is_refused() -> None:
    model, queries = small_model(PLACES), encoded(PLACES)
    blank = queries.activity.copy()
    blank[3] = 0
    with pytest.raises(InputError, match=r"^img3.png: no neuron spikes for this query, .* \(1 of 8 such queries\)"):
        verify(model, replace(queries, activity=blank), np.eye(PLACES, dtype=bool), names=("host",))


class Tampered(HostBackend):
    """A backend that loses one spike."""

    def trains(self, model: Model, shown: Presentations) -> Trains:
        host = super().trains(model, shown)
        query, step, neuron = np.argwhere(host.exc)[10]
        host.exc[query, step, neuron] = 0
        return host


@pytest.mark.lava
def test_a_lost_spike_fails_the_command(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backends, "get", lambda name, threads=1, advance=None: Tampered())
    result = CliRunner().invoke(main, ["verify", "m.lvpr", "query", "--backend", "lava-fixed", "--json", "v.json"])
    assert result.exit_code == 1
    assert result.stderr.startswith("lava-vpr: error: lava-fixed differs from the host in 1 places, first at query ")
    assert "population exc, neuron " in result.stderr
    assert "host 1, backend 0" in result.stderr
    assert json.loads(Path("v.json").read_text())["backends"]["lava-fixed"]["equal"] is False


@pytest.mark.lava
def test_every_spike_of_the_front_end_is_compared(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command with a front end in Lava's place that adds a spike of a pair: the third image's, in its own run."""
    wrong = [False]

    def in_lavas_place(target: str, arrays: Any, options: Any, **ways: Any) -> Any:
        assert target == "lava_vpr.processes.jobs.front_end:composed"
        assert options["spec"] == asdict(FRONT_END)
        films = FRONT_END.trains(arrays["grey"])
        if wrong[0] and len(arrays["grey"]) == 1:
            assert films["pairs"][0, 9, 70] == 0
            films["pairs"][0, 9, 70] = 1
        return films

    run("train", "reference", "-o", "f.lvpr", "--input", "frontend", "--learning", "template")
    monkeypatch.setattr(backends, "get", lambda name, threads=1, advance=None: HostBackend())
    monkeypatch.setattr(lava, "run_isolated", in_lavas_place)
    monkeypatch.setattr(comparing, "AT_ONCE", 2)
    asked = ("verify", "f.lvpr", "query", "--limit", 3, "--backend", "lava-fixed", "--backend", "lava-fused")
    result = run(*asked, "--json", "v.json")
    values = json.loads(Path("v.json").read_text())["backends"]
    spikes = values["host"]["spikes_by_population"]
    assert list(spikes) == [*FRONT_END.populations, "inputs", "exc", "inh"]
    assert spikes["clock"] == 3 * FRONT_END.end
    assert spikes["pixels"] == 3 * 64 * 32
    assert values["lava-fixed"] == values["host"] | {"hosts_kernel": False}
    assert list(values["lava-fused"]["spikes_by_population"]) == ["inputs", "exc", "inh"]
    before = sum(spikes[name] for name in FRONT_END.populations)
    assert re.search(rf"lava-fixed +│ every spike equal +│ +3 │ +{before:,} │", result.stdout)
    wrong[0] = True
    result = CliRunner().invoke(main, [str(word) for word in asked])
    assert result.exit_code == 1
    assert result.stderr.endswith(
        "lava-fixed differs from the host in 1 places, first at query place_00002.png, step 9, population pairs, "
        "neuron 70: host 0, backend 1; report it with the model and the query\n"
    )


@pytest.mark.lava
def test_a_float_front_end_decides_the_float_networks_inputs(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command with a float front end in Lava's place whose cells see each image's successor, the last the first."""
    seen: list[NDArray[np.uint16]] = []

    def in_lavas_place(target: str, arrays: Any, options: Any, **ways: Any) -> Any:
        assert (target, options["tag"]) == ("lava_vpr.processes.jobs.front_end:composed", "floating_pt")
        return FRONT_END.trains(np.roll(arrays["grey"], -1, axis=0))

    class Seeing(HostBackend):
        def count_spikes(self, model: Model, shown: Presentations) -> Any:
            seen.append(shown.rates)
            return super().count_spikes(model, shown)

    run("train", "reference", "-o", "f.lvpr", "--input", "frontend", "--learning", "template")
    monkeypatch.setattr(backends, "get", lambda name, threads=1, advance=None: Seeing())
    monkeypatch.setattr(lava, "run_isolated", in_lavas_place)
    words = ("verify", "f.lvpr", "query", "--limit", 3, "--backend", "lava-float", "--json", "v.json")
    run(*words)
    model = model_file.load(Path("f.lvpr"))
    own = query_presentations(model, encode_traverse(open_traverse("query").take(range(3)), model.config.encoder)).rates
    assert np.array_equal(seen[-1], np.roll(own, -1, axis=0))
    assert json.loads(Path("v.json").read_text())["backends"]["lava-float"]["equal"] is None


def test_a_front_end_without_its_pixels_is_not_compared() -> None:
    config = update(preset("loihi"), {"encoder": {"kind": "frontend"}, "learning": TEMPLATES})
    images = [render(World(0), place, "summer") for place in range(3)]
    (queries,) = encode_arrays(images, config.encoder, keep=Keep.PATCHES | Keep.THUMBNAILS)
    with pytest.raises(
        InputError, match=r"^comparing the front end: needs the images' grey pixels, which were not kept"
    ):
        verify(train([queries], config), queries, np.eye(3, dtype=bool), names=("host",))


@pytest.mark.lava
def test_every_backend_on_a_synthetic_route(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command itself, Lava and all: composed, fused, library and float."""
    monkeypatch.setattr(lava_checks, "_loihi_installed", lambda: False)
    Path("short.toml").write_text(SHORT.replace("steps = 32", "steps = 64"))
    run("train", "reference", "-o", "short.lvpr", "--config", "short.toml")
    result = run("verify", "short.lvpr", "query", "--limit", 2, "--json", "v.json")
    values = json.loads(Path("v.json").read_text())["backends"]
    assert list(values) == list(backends.BACKENDS)
    model = model_file.load(Path("short.lvpr"))
    queries = encode_traverse(open_traverse("query"), model.config.encoder)
    own = HostBackend().trains(model, query_presentations(model, queries).part(slice(2)))
    parts = {"inputs": int(own.inputs.sum()), "exc": int(own.exc.sum()), "inh": int(own.inh.sum())}
    decided = parts["exc"] + parts["inh"]
    assert 0 < decided < parts["inputs"]
    assert values["host"] == {
        "available": True,
        "equal": True,
        "queries": 2,
        "spikes_compared": decided + parts["inputs"],
        "spikes_decided": decided,
        "spikes_by_population": parts,
        "hosts_kernel": True,
    }
    assert (
        values["lava-fixed"] == values["lava-library"] == values["bundle"] == values["host"] | {"hosts_kernel": False}
    )
    assert 0 < values["lava-fused"]["spikes_compared"] < decided  # its inputs and relays have no trains of their own
    assert values["lava-fused"]["equal"] is values["lava-fused"]["hosts_kernel"] is True
    assert values["lava-fused"]["spikes_decided"] == parts["exc"]
    assert set(values["lava-float"]) == {"available", "equal", "queries", "recall_at_1"}
    assert values["lava-float"]["equal"] is None
    assert set(values["loihi2"]) == {"available", "reason"}
    alike = "Every spike that was compared equals the host's on lava-fixed, lava-library, bundle.\n"
    assert result.stdout.startswith(alike)  # the kernel of lava-fused is the host's own
    assert re.search(rf"lava-library │ every spike equal +│ +2 │ +{decided} │ +{parts['inputs']:,} │", result.stdout)
    assert re.search(rf"lava-fused +│ equal, host's kernel +│ +2 │ +{parts['exc']} │ +0 │", result.stdout)
    assert "not available" in result.stdout


@pytest.mark.slow
@pytest.mark.lava
def test_eval_on_a_lava_backend_gives_the_hosts_figures(here: Path) -> None:
    assert figures("query", "--backend", "lava-fused") == figures("query")


@pytest.mark.quick(1)
@pytest.mark.lava
@pytest.mark.parametrize(("name", "bias_input"), [*((name, False) for name in FIXED), ("lava-library", True)])
def test_counts_and_events_are_the_hosts(name: str, bias_input: bool) -> None:
    learned = small_model(PLACES)
    network = replace(learned.network, steps=40, regular=bias_input, bias_input=bias_input)
    model = replace(learned, network=network)
    shown = query_presentations(model, encoded(PLACES), 1).part(slice(0, 3))
    counts, events = backends.get("host").count_spikes(model, shown)
    got, same = backends.get(name).count_spikes(model, shown)
    assert counts.sum() > 0
    np.testing.assert_array_equal(got, counts)
    assert same == events


@pytest.mark.slow
@pytest.mark.lava
def test_integer_backends_refuse_the_float_model() -> None:
    config = update(tiny_paper(), {"network": {"steps": 1000}})  # two spikes a query
    model, queries = train([encoded(2, 784)], config), encoded(2, 784)
    host, fixed, floating = verify(model, queries, np.eye(2, dtype=bool), names=("host", "lava-fixed", "lava-float"))
    assert (host.equal, host.queries) == (True, 2)
    assert fixed.as_json() == {"available": False, "reason": fixed.reason}
    assert str(fixed.reason).startswith("lava-fixed needs an integer network, but preset paper")
    assert floating.as_json() == {"available": True, "equal": None, "queries": 2, "recall_at_1": host.recall}
    for name in FIXED:
        with pytest.raises(ConfigError, match=rf"^{name} needs an integer network, .* --backend host or lava-float"):
            backends.require(name, model)
    backends.require("lava-float", model)


@pytest.mark.lava
def test_what_is_missing_is_said_before_any_work(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lava_checks, "_loihi_installed", lambda: False)
    for command in ("eval", "verify"):
        result = CliRunner().invoke(main, [command, "m.lvpr", "nowhere", "--backend", "loihi2"])
        assert result.exit_code == 1
        assert result.stderr.startswith("lava-vpr: error: lava-loihi is not installed")
        assert result.stderr.endswith("--backend lava-library simulates the same network\n")


def test_verdicts_as_json() -> None:
    assert [name for name, row in backends.BACKENDS.items() if not row.exact] == ["lava-float"]
    assert Verdict("x", "no board").as_json() == {"available": False, "reason": "no board"}
    assert Verdict("x", None, None, 3, {"exc": 9}, recall=0.5).as_json() == {
        "available": True,
        "equal": None,
        "queries": 3,
        "recall_at_1": 0.5,
    }


@pytest.mark.lava
@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize(("bits", "mode"), [*((bits, "injected") for bits in range(1, 9)), (3, "bias")])
def test_real_queries_on_every_backend(bits: int, mode: str, data_root: Path) -> None:
    """Host, composed, fused and library-wired network: every spike of every population, for every width of weights.

    Of the preset's width twenty queries, of any other four: what a width changes is in every one of them.
    """
    config = update(preset("loihi"), {"network": {"signed": bits < 8, "input_mode": mode}})  # 8 bits: none for a sign
    config = update(config, {"network": {"weight_bits": bits}})
    model, count = learn(SECTIONS[0], config), 20 if bits == preset("loihi").network.weight_bits else 4
    queries = real("winter", config.encoder).take(slice(0, count))
    host = HostBackend().trains(model, query_presentations(model, queries))
    assert host.exc.any(axis=(1, 2)).all()
    wanted = count * config.encoder.query_spikes * integer_model(model, "the test").network.steps
    assert host.inputs.sum(dtype=np.int64) > 0.9 * wanted
    verdicts = verify(model, queries, np.eye(count, 100, dtype=bool), names=FIXED)
    for verdict in verdicts:
        print(f"{bits} bits, {verdict.name}: {verdict.decided:,} spikes of exc and inh, {verdict.spikes:,} in all")
        assert verdict.reason is None
        assert verdict.equal, verdict.mismatch
        assert verdict.queries == count
        # Of the fused Process those of exc are compared; of the others all populations.
        seen = (host.exc,) if verdict.name == "lava-fused" else (host.inputs, host.exc, host.inh)
        assert verdict.spikes == sum(int(spikes.sum(dtype=np.int64)) for spikes in seen)


@pytest.mark.lava
@pytest.mark.data
@pytest.mark.slow
def test_real_queries_from_pixels_on(data_root: Path) -> None:
    """Every spike of every layer of a map of 100 places, front end and network: of Lava and a bundle."""
    config = update(preset("loihi"), {"encoder": {"kind": "frontend"}, "learning": TEMPLATES})
    model = learn(SECTIONS[0], config)
    winter = open_traverse(images_of("nordland", "winter")).take(range(5))
    queries = encode_traverse(winter, config.encoder, Keep.GREY)
    films = FRONT_END.trains(queries.kept(Keep.GREY, "the test"))
    assert np.array_equal(films["cells"].sum(axis=1), queries.activity)
    for verdict in verify(
        model, queries, np.eye(5, 100, dtype=bool), names=("host", "lava-fixed", "lava-library", "bundle")
    ):
        print(f"{verdict.name}: {verdict.compared}")
        assert verdict.equal, verdict.mismatch or verdict.reason
        assert min(verdict.compared.values()) > 0
        assert {name: verdict.compared[name] for name in films} == {name: film.sum() for name, film in films.items()}


@pytest.mark.lava
@pytest.mark.data
@pytest.mark.slow
def test_the_float_network_recognises_as_well(data_root: Path) -> None:
    """Every fifth query of all five sections through the floating-point Processes: R@1 within 0.02 of the integers'."""
    found: dict[str, list[float]] = {"host": [], "lava-float": []}
    for first, end in SECTIONS:
        model = learn((first, end), preset("loihi"))
        queries = real("winter", model.config.encoder).take(slice(first, end, 5))
        truth = np.eye(100, dtype=bool)[::5]
        for name, recalls in found.items():
            result = recognise(model, queries, truth, DECODERS_ONLY, backend=name)
            recalls.append(result.metrics[result.default].recall_at_1)
    fixed, floating = map(np.mean, found.values())
    print(f"R@1 of five sections: integers {fixed:.3f}, float {floating:.3f}")
    assert fixed > 0.85
    assert abs(fixed - floating) <= 0.02
