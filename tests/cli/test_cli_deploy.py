"""``lava-vpr fit`` and ``lava-vpr deploy``: what fits, what is written, what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from support.common.commands import PLACES, fails, run

from lava_vpr import model
from lava_vpr.deploy.bundle.folder import load as read
from lava_vpr.engine.inference import biases

ONE_CORE = r"│ 0:0 +│ exc 0\.\.7 +│ +17 of 1,024 │.*\n│ +│ counters 0\.\.7 +│.*\n│ +│ inh 0 +│"

KAPOHO_BAY = ("--target", "kapoho-bay")


# --- fit -------------------------------------------------------------------------------------------------------------


def test_fit_says_what_each_core_holds(here: Path) -> None:
    text = run("fit", "m.lvpr", *KAPOHO_BAY).stdout
    assert re.search(ONE_CORE, text), text
    assert re.search(r"│ all +│ 1 of 256 cores +│", text)
    assert text.startswith("It fits Kapoho Bay (two Loihi 1 chips): 1 of 256 cores, 4 bits a stored weight.\n")
    assert re.search(
        r"The host sends up to [\d.]+ spikes a step", run("deploy", "m.lvpr", *KAPOHO_BAY, "-o", "b").stdout
    )
    text = run("fit", "m.lvpr", "--target", "loihi2").stdout
    assert text.startswith("It may fit Loihi 2: at least 1 of 128 cores, 4 bits a stored weight.\n")
    assert "unknown" in text
    assert "is decided by Intel's compiler" in run("deploy", "m.lvpr", "--target", "loihi2", "-o", "b").stdout
    text = run("fit", "m.lvpr", *KAPOHO_BAY, "--input-mode", "bias").stdout
    assert re.search(r"inputs \d+\.\.2047", text)


def test_fit_tells_of_a_small_map_in_two_sentences_and_a_table(here: Path) -> None:
    rests = r"this rests on {} beliefs that no public source shows \(docs/hardware\.md\)\.\n"
    for target, beliefs, last in (
        ("kapoho-bay", 11, r"A query of its references is modelled to take \S+ ms \(.*\), a step \S+ µs \(.*\); "),
        ("loihi2", 5, "Whether it fits is unknown: it is beyond none of the public numbers; "),
    ):
        text = run("fit", "m.lvpr", "--target", target, "--json", "f.json").stdout
        table = r".*\n([┏┃┡│├└].*\n)+axons out.*\n"
        assert re.fullmatch(f"It .*\n{table}{last}{rests.format(beliefs)}", text), text
        assert len(json.loads(Path("f.json").read_text())["unproven"]) == beliefs


def test_fit_writes_a_picture_and_figures(here: Path) -> None:
    words = ("fit", "m.lvpr", "--target", "kapoho-bay", "--weight-bits", 2)
    text = run(*words, "--picture", "p.svg", "--json", "f.json").stdout
    assert text.endswith("picture: p.svg\n")
    assert Path("p.svg").read_text().startswith("<?xml")
    values = json.loads(Path("f.json").read_text())
    assert (values["target"], values["fits"], values["places"], values["weight_bits"]) == ("kapoho-bay", True, 8, 2)
    (core,) = values["mapping"]["cores"]
    assert core["parts"][0] == {"population": "exc", "first": 0, "size": 8, "compartment": 0}
    before = Path("p.svg").read_bytes(), Path("f.json").read_bytes()
    run(*words, "--picture", "p.svg", "--json", "f.json")
    assert (Path("p.svg").read_bytes(), Path("f.json").read_bytes()) == before


@pytest.mark.slow
def test_fit_without_a_model_tells_the_largest_map(here: Path) -> None:
    text = run("fit", "--target", "kapoho-bay", "--weight-bits", 3, "--json", "c.json").stdout
    values = json.loads(Path("c.json").read_text())
    assert values["target"] == "kapoho-bay"
    row, every, *others = values["largest"]
    assert [(other["rows"], other["weights"]) for other in others] == [("dense", "typical"), ("dense", "every")]
    assert (row["weight_bits"], row["rows"], row["proven"], every["weights"]) == (3, "sparse", False, "every")
    assert row["narrow"] is True
    assert "sparse (unproven)" in text
    assert row["neurons"] == row["places"] > every["places"] > 8000
    assert re.search(
        rf"│ +3 │ sparse \(unproven\) +│ +{row['places']:,} │ +{row['cores']} │ +{every['places']:,} │", text
    )
    assert f"{100 * row['share']:.0f}" == "62"
    assert "public sources alone" not in text
    assert "dense (unproven)" in text
    run("fit", "--target", "kapoho-bay", "--weight-bits", 3, "--neurons-per-place", 2, "--json", "d.json")
    twice = json.loads(Path("d.json").read_text())["largest"][0]
    assert twice["neurons"] == 2 * twice["places"]
    assert twice["places"] < row["places"]
    text = run("fit", "--target", "kapoho-bay", "--weight-bits", 3, "--views", 3, "--json", "v.json").stdout
    seen = json.loads(Path("v.json").read_text())
    assert seen["views"] == 3
    assert "each place in 3 views" in text
    assert seen["largest"][0]["neurons"] == 3 * seen["largest"][0]["places"]
    assert seen["largest"][0]["neurons"] == pytest.approx(row["neurons"], rel=0.1)


def test_what_does_not_fit_is_one_line(here: Path) -> None:
    said = fails("fit", "m.lvpr", "--target", "kapoho-bay", "--weight-bits", 8)
    assert "network.weight_bits is 8, but must be in [1, 7]" in said
    Path("many.toml").write_text("[encoder]\nquery_spikes = 60.0\n[learning]\nepochs = 1\n")
    run("train", "reference", "-o", "many.lvpr", "--config", "many.toml")
    said = fails("fit", "many.lvpr", "--target", "kapoho-bay")
    assert "input spikes a step" in said
    assert "--input-mode bias" in said
    run("fit", "many.lvpr", "--target", "kapoho-bay", "--input-mode", "bias")


# --- deploy ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", ["kapoho-bay", "loihi2"])
def test_deploy_writes_a_bundle(target: str, here: Path) -> None:
    words = ("--target", target, "-o", "b", "--input-mode", "injected")
    text = run("deploy", "m.lvpr", *words, "--json", "d.json").stdout
    assert text.endswith("bundle: b\n")
    bundle = read(Path("b"))
    assert bundle.target == target
    assert bundle.manifest["compression"] is None
    assert bundle.manifest["input"]["mode"] == "injected"
    learned = model.load("m.lvpr")
    assert np.array_equal(bundle.array("host/responses.npy"), learned.responses)
    values = json.loads(Path("d.json").read_text())
    assert values == {
        "target": target,
        "places": PLACES,
        "neurons": PLACES,
        "weight_bits": 3,
        "cores": 1,
        "compression": None,
        "learning": None,
        "unproven": bundle.manifest["unproven"],
        "modelled": bundle.manifest["modelled"],
    }
    assert (values["modelled"] is None) == (target == "loihi2")
    # Once more, over the old one: the same bytes.
    run("deploy", "m.lvpr", *words)
    assert read(Path("b")).files == bundle.files
    # A bundle is a model, too, but for its float weights.
    run("fit", "b", "--target", target)
    assert "no float weights to quantise again" in fails("fit", "b", "--target", target, "--weight-bits", 2)


def test_on_loihi_2_inputs_integrate_a_bias_unless_asked(here: Path) -> None:
    words = ("m.lvpr", "--target", "loihi2")
    done = run("deploy", *words, "-o", "b")
    assert "note: inputs integrate a bias, as Loihi 2 is given them unless --input-mode injected asks" in done.stderr
    bundle = read(Path("b"))
    paused = "bias_mant, bias_exp and v are written while the run is paused"
    assert bundle.manifest["unproven"][-1] == paused
    said = "Rests on 5 beliefs that no public source shows (docs/hardware.md): 3 of every bundle for this board; "
    assert f"{said}the longest interval between two resets; {paused}.\nbundle: b\n" in done.stdout
    assert bundle.manifest["input"] == {"mode": "bias", "trains": "regular", "host_spikes_per_step": 0.0}
    assert bundle.json("network/parameters.json")["inputs"] == {"du": 4095, "dv": 0, "vth": biases.THRESHOLD}
    assert "The host sends no spikes: inputs integrate a bias" in done.stdout
    assert read(Path("b")).manifest["clearing"]["reset_interval"] == model.load("m.lvpr").config.network.steps
    # A bundle stays as it is: it has no float weights to quantise again.
    assert "The host sends up to" in run("deploy", *words, "-o", "i", "--input-mode", "injected").stdout
    run("deploy", "i", "--target", "loihi2", "-o", "again")
    assert read(Path("again")).manifest["input"]["mode"] == "injected"


def test_what_a_bundle_relies_on_without_a_source_is_said(here: Path) -> None:
    narrow = "; synapseFmt.wgtBits (weights of fewer than 8 bits); Wgt with fewer bits: the upper ones"
    for words, every, own in (
        (("--target", "kapoho-bay"), 9, narrow),
        (("--target", "kapoho-bay", "--weight-bits", 7), 9, ""),
        (("--target", "loihi2", "--input-mode", "injected"), 3, "; the longest interval between two resets"),
    ):
        deployed = run("deploy", "m.lvpr", *words, "-o", "b")
        fitted = run("fit", "m.lvpr", *words, "--json", "f.json").stdout
        unproven = read(Path("b")).manifest["unproven"]
        assert json.loads(Path("f.json").read_text())["unproven"] == unproven
        assert len(unproven) == every + own.count(";")
        said = f"ests on {len(unproven)} beliefs that no public source shows (docs/hardware.md)"
        assert f"R{said}: {every} of every bundle for this board{own}.\n" in deployed.stdout
        assert f"this r{said}.\n" in fitted


def test_rows_without_indices_are_stored_only_where_they_are_asked_for(here: Path) -> None:
    said = "; synapseFmt.idxBits (rows without indices)"
    for words in ((), ("--dense-rows",)):
        run("fit", "m.lvpr", "--target", "kapoho-bay", "--json", "f.json", *words)
        done = run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "b", *words)
        found = read(Path("b")).json("mapping.json")
        assert found == json.loads(Path("f.json").read_text())["mapping"]
        assert (sum(core["dense_input_rows"] for core in found["cores"]) > 0) == bool(words)
        unproven = read(Path("b")).manifest["unproven"]
        assert unproven == json.loads(Path("f.json").read_text())["unproven"]
        assert ("synapseFmt.idxBits (rows without indices)" in unproven) == bool(words)
        assert (said in done.stdout) == bool(words)
        assert run("verify", "b", "query", "--backend", "bundle").exit_code == 0


@pytest.mark.slow
def test_fit_for_loihi_2_promises_nothing(here: Path) -> None:
    text = run("fit", "--target", "loihi2", "--weight-bits", 7, "--json", "f.json").stdout
    assert "no larger maps can fit Loihi 2" in text
    assert "places at most" in text
    assert "cores at least" in text
    assert "Whether maps of these sizes fit is unknown." in " ".join(text.split())
    assert [row["at_most"] for row in json.loads(Path("f.json").read_text())["largest"]] == [True, True]
    text = " ".join(run("fit", "m.lvpr", "--target", "loihi2", "--json", "m.json").stdout.split())
    assert "It may fit Loihi 2: at least 1 of 128 cores" in text
    assert "Whether it fits is unknown: it is beyond none of the public numbers; this rests on" in text
    assert json.loads(Path("m.json").read_text())["fits"] is None
    text = run("fit", "--target", "kapoho-bay", "--weight-bits", 7, "--json", "k.json").stdout
    proven = [row["places"] for row in json.loads(Path("k.json").read_text())["largest"] if row["proven"]]
    assert text.startswith(f"{max(proven):,} places fit Kapoho Bay (two Loihi 1 chips) by public sources alone, with")
    assert "no larger maps" not in text


def test_deploy_compresses_and_tells_recall_before_and_after(here: Path) -> None:
    words = ("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "b", "--calibrate", "query", "--json", "d.json")
    text = run(*words, "--weight-bits", 2, "--prune", 0.5, "--input-mode", "bias").stdout
    assert re.search(r"│ the model's │ +3 │ +0\.0 │ +[\d.]+ │ +[\d.]+ │ +[\d.]+ │ +[\d,]+ │", text), text
    assert re.search(r"│ deployed +│ +2 │ +50\.0 │ +[\d.]+ │", text)
    done = read(Path("b")).manifest
    assert done["input"]["mode"] == "bias"
    assert done["network"]["bits"] == 2
    assert done["compression"] == json.loads(Path("d.json").read_text())["compression"]
    assert done["compression"]["prune"] == 0.5
    assert set(done["compression"]["calibration"]) == {"before", "after"}
    assert "search" not in done["compression"]


@pytest.mark.slow
def test_deploy_searches_for_the_cheapest_weights(here: Path) -> None:
    words = ("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "b", "--calibrate", "query", "--places", "2:8")
    text = run(*words, "--max-loss", 0.2).stdout
    values = read(Path("b")).manifest["compression"]
    before, after = (values["calibration"][when] for when in ("before", "after"))
    assert after["recall_at_1"] >= before["recall_at_1"] - 0.2
    assert after["operations"] < 0.7 * before["operations"]
    assert values["search"]["max_loss"] == 0.2
    assert text.count("│ tried") == len(values["search"]["tried"]) - 1
    assert text.count("│ deployed") == 1
    assert "keeps R@1 within 0 of " in fails(*words, "--prune", 0.999, "--max-loss", 0)


def test_what_the_chip_learns_is_printed_beside_the_model(here: Path) -> None:
    words = ("--target", "loihi2", "-o", "b", "--learning")
    text = run("deploy", "m.lvpr", *words, "--calibrate", "query", "--json", "d.json").stdout
    assert re.search(r"│ learned on the chip +│ +3 │ +0\.0 │ +\d", text)
    figures = json.loads(Path("d.json").read_text())["learning"]
    assert 0.5 <= figures["recall_at_1"] <= 1
    bundle = read(Path("b"))
    assert bundle.json("learning/learning.json")["stretches"][0]["phases"][0]["learning_rule"]["t_epoch"] == 1
    assert "`learning/`" in bundle.data("README.md").decode()
