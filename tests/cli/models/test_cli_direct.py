"""From pixels to places by command: neurons that hear the cells of the front end themselves."""

from __future__ import annotations

import csv
import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.common.commands import PLACES, fails, run
from support.common.teaching import teach_quickly

from lava_vpr.backends.asking import Asker, Asking
from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.deploy.bundle.folder import array_bytes
from lava_vpr.deploy.bundle.targets import open_bundle
from lava_vpr.encoding import Keep, encode_traverse
from lava_vpr.engine.gains import FULL
from lava_vpr.engine.inference.whole import WholeNetwork, counts_of
from lava_vpr.errors import LavaVprError
from lava_vpr.localizer import Localizer
from lava_vpr.model import integer_model, load
from lava_vpr.season.file import load as load_season
from lava_vpr.training.loop import integer_network
from lava_vpr.traverse import open_traverse

LEARN = ("train", "reference", "--input", "frontend-direct", "--learning", "template")
ELSEWHERE = "these neurons hear the cells of the front end themselves"


@pytest.fixture(scope="module")
def learned(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of the small route."""
    file = tmp_path_factory.mktemp("direct") / "d.lvpr"
    run("train", made / "reference", *LEARN[2:], "-o", file)
    return file


@pytest.fixture
def direct(here: Path, learned: Path) -> Path:
    """The model in a folder of its own."""
    return Path(shutil.copy(learned, here))


def answers(*words: object) -> list[dict[str, str]]:
    """The rows that ``query`` writes."""
    return list(csv.DictReader(io.StringIO(run("query", "d.lvpr", "query", *words).stdout)))


def test_every_place_is_recognised_and_the_file_keeps_it(direct: Path) -> None:
    run("eval", "d.lvpr", "query", "--json", "e.json")
    evaluated = json.loads(Path("e.json").read_text())
    assert evaluated["decoders"]["contrast"]["recall_at_1"] == 1
    assert evaluated["network"]["steps"] == 49
    model = integer_model(load(direct), "the test")
    spec = model.config.encoder.direct
    assert spec is not None
    assert (model.network.interval, model.network.rising) == (spec.steps, spec.rising) == (49, 36)
    queries = encode_traverse(open_traverse("query"), model.config.encoder, Keep.GREY)
    counts = counts_of(WholeNetwork.of(spec, model.network), queries.kept(Keep.GREY, "the test"))
    assert counts.argmax(axis=1).tolist() == list(range(PLACES))
    robot = Localizer(model)
    assert [robot.update(image).place for image in open_traverse("query").images()] == list(range(PLACES))


def test_extended_and_merged_are_what_is_trained_together(direct: Path) -> None:
    run(*LEARN, "-o", "a.lvpr", "--places", "0:4")
    run(*LEARN, "-o", "b.lvpr", "--places", "4:8")
    run("extend", "a.lvpr", "reference", "--places", "4:8", "-o", "extended.lvpr")
    run("merge", "a.lvpr", "b.lvpr", "-o", "merged.lvpr")
    assert Path("extended.lvpr").read_bytes() == Path("merged.lvpr").read_bytes()


def test_a_bundle_counts_as_the_host_from_its_files_alone(direct: Path) -> None:
    run("deploy", "d.lvpr", "--target", "kapoho-bay", "-o", "b", "--json", "d.json")
    said = json.loads(Path("d.json").read_text())
    run("fit", "d.lvpr", "--target", "kapoho-bay", "--json", "f.json")
    fitted = json.loads(Path("f.json").read_text())
    assert fitted["fits"] is True
    assert fitted["front_end"]["cores"] == said["cores"]
    assert list(fitted["front_end"]["populations"])[-3:] == ["exc", "inh", "counters"]
    shown = run("verify", "b", "query", "--limit", "3", "--backend", "bundle", "--json", "v.json").stdout
    assert "every spike equal" in shown
    compared = json.loads(Path("v.json").read_text())["backends"]["bundle"]["spikes_by_population"]
    assert list(compared) == ["clock", "pixels", "filters", "pairs", "onsets", "cells", "pools", "exc", "inh"]
    assert min(compared.values()) > 0
    assert answers("--places", "0:3", "--backend", "bundle") == answers("--places", "0:3")


def test_a_bundle_for_loihi_2_counts_as_the_host_from_its_files_alone(direct: Path) -> None:
    said = run("deploy", "d.lvpr", "--target", "loihi2", "-o", "b", "--json", "d.json").stdout
    assert "it takes 49 steps, and neurons are reset every 64." in " ".join(said.split())
    assert json.loads(Path("d.json").read_text())["target"] == "loihi2"
    run("verify", "b", "query", "--limit", "2", "--backend", "bundle", "--json", "v.json")
    backends = json.loads(Path("v.json").read_text())["backends"]
    assert backends["bundle"]["equal"] is True
    assert backends["bundle"]["spikes_by_population"] == backends["host"]["spikes_by_population"]
    assert backends["bundle"]["spikes_decided"] > 0


def test_neurons_that_hear_cells_adapt(direct: Path) -> None:
    """Their biases follow the counts of cells, alike on every backend, and in batches as one query after another."""
    run("eval", "d.lvpr", "query", "--adapt", "3", "--json", "e.json")
    assert json.loads(Path("e.json").read_text())["adapted"]["contrast"]["recall_at_1"] == 1
    adapted = answers("--adapt", "1")
    assert [row["confidence"] for row in adapted] != [row["confidence"] for row in answers("--adapt", "off")]
    assert answers("--adapt", "1", "--backend", "bundle") == adapted
    robot = Localizer(load(direct), adapt=1.0)
    found = [robot.update(image) for image in open_traverse("query").images()]
    assert [repr(one.confidence) for one in found] == [row["confidence"] for row in adapted]
    run("verify", "d.lvpr", "query", "--limit", "4", "--adapt", "1", "--backend", "bundle", "--json", "v.json")
    compared = json.loads(Path("v.json").read_text())["backends"]["bundle"]
    assert (compared["equal"], compared["spikes_decided"] > 0) == (True, True)
    run("bench", "d.lvpr", "query", "--backend", "host", "--adapt", "1", "--json", "b.json", "--limit", "3")
    energy = json.loads(Path("b.json").read_text())["energy"]
    plain, more = (energy[name]["dynamic_microjoules"]["nominal"] for name in ("kapoho-bay", "kapoho-bay, adapted"))
    assert plain < more < 1.01 * plain


def test_neurons_that_hear_cells_learn_the_season(direct: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gains multiply what was learned, quantised anew in each epoch; a season that is known is the same everywhere."""
    teach_quickly(monkeypatch)
    run("eval", "d.lvpr", "query", "--learn", "--json", "e.json")
    evaluated = json.loads(Path("e.json").read_text())
    assert evaluated["learned"]["contrast"]["recall_at_1"] == 1
    assert evaluated["taught"]["single"]["answers"] >= 4
    robot = Localizer("d.lvpr", "none", learn=True)
    found = [robot.update(image) for image in open_traverse("query").images()]
    assert [repr(one.confidence) for one in found] == [row["confidence"] for row in answers("--learn")]
    robot.save_season("s.lvps")
    model, season = integer_model(load(direct), "the test"), load_season("s.lvps")
    assert 0 < season.gains.mean() < FULL
    shares = season.gains[:, None] / np.float32(FULL)
    wanted = integer_network(model.learned * shares, model.config, model.stretches, model.activity)
    assert not np.array_equal(wanted.weights, model.network.weights)
    asker = Asker(model, Asking(season=season))
    shown = asker.presentations([encode_traverse(open_traverse("query"), model.config.encoder)])
    assert shown.bias is not None
    assert (shown.bias == wanted.bias).all()
    run("season", "d.lvpr", "s.lvps", "--apply", "a.lvpr")
    for one in (asker.model, load("a.lvpr")):
        network = integer_model(one, "the test").network
        assert np.array_equal(network.weights, wanted.weights)
        assert np.array_equal(network.bias, wanted.bias)
    run("verify", "d.lvpr", "query", "--limit", "3", "--season", "s.lvps", "--backend", "bundle", "--json", "v.json")
    assert json.loads(Path("v.json").read_text())["backends"]["bundle"]["equal"] is True
    frozen = answers("--season", "s.lvps")
    assert answers("--season", "s.lvps", "--backend", "bundle") == frozen != answers("--adapt", "off")
    run("deploy", "d.lvpr", "--target", "kapoho-bay", "--season", "s.lvps", "-o", "b")
    assert np.array_equal(np.load("b/host/weights.npy"), wanted.weights)


def test_bench_counts_pixels_to_places(direct: Path) -> None:
    run("bench", "d.lvpr", "query", "--backend", "host", "--json", "b.json", "--limit", "3")
    values = json.loads(Path("b.json").read_text())
    run("bench", "d.lvpr", "query", "--backend", "host", "--json", "one.json", "--limit", "3", "--target", "loihi2")
    assert json.loads(Path("one.json").read_text())["front_end"] == {"loihi2": values["front_end"]["loihi2"]}
    costs = values["front_end"]["kapoho-bay"]
    assert list(costs["registers"]) == ["pixels", "clearing of states", "counts of exc"]
    assert costs["registers"]["counts of exc"] == PLACES
    assert costs["layers"]["exc"]["spikes"] > 0
    assert costs["layers"]["counters"]["spikes"] == 0
    assert "counters" not in values["front_end"]["loihi2"]["layers"]
    board = values["energy"]["kapoho-bay"]
    summed = sum(one["nominal"] for part in ("dynamic", "between") for one in costs[f"{part}_microjoules"].values())
    assert board["dynamic_microjoules"]["nominal"] == pytest.approx(summed)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("eval", "d.lvpr", "query", "--learn", "--gains", "g.lvpg"),
            f"--gains needs rates of inputs, but {ELSEWHERE}; write a map with the gains in its weights: ",
        ),
        (("eval", "b", "query", "--learn"), "a bundle keeps no float weights to multiply by gains, and these neurons"),
        pytest.param(
            ("eval", "d.lvpr", "query", "--backend", "lava-fused"),
            f"lava-fused takes inputs that have rates, but {ELSEWHERE}",
            marks=pytest.mark.lava,
        ),
        (("export", "d.lvpr", "-o", "d.nir"), f"d.lvpr: format nir takes inputs that have rates, but {ELSEWHERE}"),
        (
            ("deploy", "d.lvpr", "--target", "kapoho-bay", "-o", "b", "--weight-bits", "2"),
            f"d.lvpr: --weight-bits is for inputs that have rates, but {ELSEWHERE}; leave out --weight-bits",
        ),
        (
            ("fit", "d.lvpr", "--target", "kapoho-bay", "--picture", "p.svg"),
            f"d.lvpr: --picture is for inputs that have rates, but {ELSEWHERE}",
        ),
        (("bench", "d.lvpr", "query", "--sweep"), f"d.lvpr: --sweep: {ELSEWHERE}"),
        (
            (*LEARN[:4], "-o", "x.lvpr", "--learning", "slayer"),
            "encoder.kind 'frontend-direct' takes the network lif with signed weights",
        ),
        (
            (*LEARN, "-o", "x.lvpr", "--config", "bias.toml"),
            "encoder.kind 'frontend-direct' takes the network lif with signed weights, its trains regular and injected",
        ),
    ],
)
def test_what_needs_rates_of_inputs_is_refused_in_one_line(direct: Path, words: tuple[str, ...], said: str) -> None:
    Path("bias.toml").write_text('[network]\ninput_mode = "bias"\n')
    if "b" in words[:2]:
        run("deploy", "d.lvpr", "--target", "kapoho-bay", "-o", "b")
    assert fails(*words).startswith(said)


def test_a_bundle_of_another_network_is_refused(direct: Path) -> None:
    run("deploy", "d.lvpr", "--target", "kapoho-bay", "-o", "b")
    whole = bundle_folder.load(Path("b"))
    weights = np.load("b/host/weights.npy")
    weights[0, 0] ^= 1
    core = next(name for name in whole.files if name.startswith("front_end/cores/") and name.endswith("synapses.npy"))
    words = np.load(f"b/{core}")
    words[-1] ^= np.uint64(1 << 40)
    told = {key: value for key, value in whole.manifest.items() if key not in ("format", "version", "files", "sha256")}
    for changed, change, said in (
        ({"host/weights.npy": array_bytes(weights)}, {}, "front_end/cores"),
        ({core: array_bytes(words)}, {}, core),
        ({"host/counts.npy": array_bytes(np.load("b/host/counts.npy") + 1)}, {}, "host/counts.npy"),
        ({"host/weights.npy": array_bytes(1000 * weights)}, {}, "host/weights.npy: is no network of ours"),
        ({}, {"rising": 31}, "no valid rising from step 31 where the settings say 36"),
        ({}, {"rising": 0}, "has rising 0, of 1..46"),
        ({}, {"steps": 60}, "no valid presentations of steps 62 where the settings say 49"),
    ):
        manifest = {**told, "network": {**told["network"], **change}}
        bundle_folder.write(Path("changed"), manifest, {**whole.files, **changed})
        with pytest.raises(LavaVprError) as caught:
            open_bundle(Path("changed"))
        assert said in str(caught.value), str(caught.value)
