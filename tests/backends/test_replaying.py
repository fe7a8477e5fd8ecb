"""What a drive that learned was presented with, written down and replayed: everywhere the same spikes are counted."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from support.common.commands import content, fails, figures, images, listed, matches, run
from support.common.teaching import teach_quickly

from lava_vpr import load
from lava_vpr.backends import lava, registry as backends
from lava_vpr.backends.answering import Answered, answer_stream
from lava_vpr.backends.asking import Asker, Asking
from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.cli import main
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import LOIHI_2
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.encoding import encode_traverse
from lava_vpr.engine.gains import FULL
from lava_vpr.engine.presentations import Trains
from lava_vpr.matching.answers import Together
from lava_vpr.model import Model, integer_model
from lava_vpr.season import table as gain_table
from lava_vpr.season.file import unlearned
from lava_vpr.season.table import GainTable, map_of
from lava_vpr.storage import container
from lava_vpr.traverse import open_traverse

LEARNING = Asking(adapt=30, learn=True)


@pytest.fixture(autouse=True)
def quick_to_learn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A drive of eight images has several epochs."""
    teach_quickly(monkeypatch)


@pytest.fixture
def table(here: Path) -> Path:
    """What ``query --learn --motion any`` was presented with."""
    run("query", "m.lvpr", "query", "--learn", "--motion", "any", "-o", "learned.csv", "--gains", "g.lvpg")
    return Path("g.lvpg")


def drive(asking: Asking, backend: str = "host", model: str = "m.lvpr") -> list[Answered]:
    """Answers to the route's queries."""
    together = Together(motion="any")
    return list(answer_stream(load(model), open_traverse("query"), backend=backend, together=together, asking=asking))


def drive_rates(table: Path) -> NDArray[np.uint16]:
    """Rates of the queries under the table's gains, (queries, inputs)."""
    model, asking = load("m.lvpr"), Asking(replay=gain_table.load(table))
    return Asker(model, asking).presentations((encode_traverse(open_traverse("query"), model.config.encoder),)).rates


def counts(parts: list[Answered]) -> NDArray[np.int32]:
    """Their spike counts (queries, neurons)."""
    return np.concatenate([part.counts for part in parts])


def test_the_table_is_what_was_used(table: Path) -> None:
    learned, known = drive(LEARNING), gain_table.load(table)
    used = [part.used for part in learned if part.used is not None]
    assert len(used) == len(learned) > 2
    assert known.epoch.tolist() == sorted(known.epoch.tolist())
    assert known.epoch.max() + 1 == len(known.gains) > 1
    assert (known.gains[0] == FULL).all()
    assert (known.gains[-1] < FULL).any()
    for name, rows in (("gains", known.gains[known.epoch]), ("bias", known.bias), ("images", known.images)):
        wanted = [getattr(part, name) for part in used]
        if name == "gains":
            wanted = [np.repeat(part.gains[None], len(part.images), axis=0) for part in used]
        assert np.array_equal(rows, np.concatenate(wanted))


def test_the_host_replays_to_the_same_bytes(table: Path) -> None:
    first = Path("learned.csv").read_bytes()
    run("query", "m.lvpr", "query", "--replay", table, "--motion", "any", "-o", "again.csv")
    assert Path("again.csv").read_bytes() == first
    run("query", "m.lvpr", "query", "--learn", "--motion", "any", "-o", "q.csv", "--gains", "h.lvpg")
    assert Path("h.lvpg").read_bytes() == table.read_bytes()
    learned = counts(drive(LEARNING))
    assert np.array_equal(counts(drive(Asking(replay=gain_table.load(table)))), learned)
    assert (learned != counts(drive(Asking(adapt=30)))).any()


@pytest.mark.lava
@pytest.mark.parametrize(
    "backend", ["bundle", *(pytest.param(name, marks=pytest.mark.slow) for name in ("lava-fixed", "lava-fused"))]
)
def test_every_backend_replays_to_the_same_counts(table: Path, backend: str) -> None:
    replayed = drive(Asking(replay=gain_table.load(table)), backend)
    assert np.array_equal(counts(replayed), counts(drive(LEARNING)))


def test_a_board_s_folder_replays_what_its_model_learned(table: Path) -> None:
    deploy(load("m.lvpr"), LOIHI_2, Path("b"), picture=False)
    replayed = drive(Asking(replay=gain_table.load(table)), "bundle", "b")
    assert np.array_equal(counts(replayed), counts(drive(LEARNING)))


@pytest.mark.lava
def test_backends_are_compared_on_a_replay(table: Path) -> None:
    said = run("verify", "m.lvpr", "query", "--backend", "bundle", "--replay", table, "--limit", 6).stdout
    assert "every spike equal" in said


@pytest.mark.lava
@pytest.mark.slow
def test_products_of_activity_and_gain_are_compared_in_lava(table: Path) -> None:
    names = ("lava-fixed", "lava-library", "lava-float")
    run("verify", "m.lvpr", "query", *(f"--backend={name}" for name in names), "--replay", table, "--json", "v.json")
    said = json.loads(Path("v.json").read_text())["backends"]
    inputs = gain_table.load(table).gains.shape[1]
    for name in names[:2]:
        assert said[name]["products_compared"] == 8 * inputs
        assert said[name]["spikes_by_population"] == said["host"]["spikes_by_population"]
    assert set(said["lava-float"]) == {"available", "equal", "queries", "recall_at_1"}


@pytest.mark.lava
@pytest.mark.parametrize("views", [1, 3])
def test_rates_follow_from_the_products_of_the_backend(
    table: Path, monkeypatch: pytest.MonkeyPatch, views: int
) -> None:
    """The command with Processes in Lava's place whose last product is sixteen times what it is."""
    wrong, presented = [False], []

    def in_lavas_place(target: str, arrays: Any, options: Any, **ways: Any) -> Any:
        assert (target, options) == ("lava_vpr.processes.jobs.gains:composed", {"tag": "fixed_pt"})
        gained = arrays["digits"].astype(np.int64) * arrays["gains"][arrays["epoch"]][:, None]
        assert np.array_equal(arrays["epoch"], np.tile(gain_table.load(table).epoch, views))
        gained[-1, :, largest] *= 16 if wrong[0] else 1
        return {"gained": gained}

    class Seeing(HostBackend):
        def trains(self, model: Model, shown: Presentations) -> Trains:
            presented.append(shown.rates)
            return super().trains(model, shown)

    largest = int(drive_rates(table)[-1].argmax())
    monkeypatch.setattr(backends, "get", lambda name, threads=1, advance=None: Seeing())
    monkeypatch.setattr(lava, "run_isolated", in_lavas_place)
    asked = ("verify", "m.lvpr", "query", "--replay", table, "--query-views", views, "--backend", "lava-fixed")
    assert re.search(r"lava-fixed +│ every spike equal +│ +8 │ +[\d,]+ │", run(*asked).stdout)
    wrong[0] = True
    result = CliRunner().invoke(main, [str(word) for word in asked])
    assert result.exit_code == 1
    assert f"query place_00007.png, population inputs under gains, neuron {largest}: host " in result.stderr
    before, after = (rates[-1, largest] for rates in presented)
    assert after > 2 * before


@pytest.mark.parametrize("motion", ["none", "any"])
def test_eval_writes_what_it_used_and_replays_it(here: Path, motion: str) -> None:
    words = ("query", "--motion", motion)
    learned = figures(*words, "--learn", "--gains", "g.lvpg")
    replayed = figures(*words, "--replay", "g.lvpg")
    which = "learned" if motion == "none" else "followed"
    assert replayed[which] == learned[which]
    assert {name: some["answers"] for name, some in replayed["taught"].items()} == dict.fromkeys(learned["taught"], 0)
    asked = matches(*words, "--learn")
    assert matches(*words, "--replay", "g.lvpg") == asked


def test_a_season_is_replayed_too(here: Path) -> None:
    model = integer_model(load("m.lvpr"), "a test")
    gains = np.arange(model.config.encoder.inputs, dtype=np.uint8) % (FULL + 1)
    known = dataclasses.replace(unlearned(model), gains=gains)
    parts = drive(Asking(season=known))
    table = GainTable.of(model, [part.used for part in parts if part.used is not None])
    assert len(table.gains) == 1
    assert np.array_equal(counts(drive(Asking(replay=table))), counts(parts))


def test_a_part_of_a_drive_and_further_views_are_replayed(table: Path) -> None:
    whole = matches("query", "--replay", table)
    listed("some.txt", images("query")[:5])
    assert matches("some.txt", "--replay", table) == whole[:5]
    assert matches("query", "--replay", table, "--query-views", 3) != whole


def test_other_queries_than_the_table_s_are_refused(table: Path) -> None:
    some = listed("some.txt", images("query")[1:])
    before = content(Path())
    said = fails("query", "m.lvpr", some, "--replay", table, "-o", "q.csv")
    assert said.startswith(
        "g.lvpg: its query 0 is another image than place_00001.png; give the images that it was written with"
    )
    assert content(Path()) == before
    listed("some.txt", [*images("query"), images("query")[0]])
    for words in (("query", "-o", "q.csv"), ("query", "-o", "q.csv", "--backend", "bundle")):
        said = fails(words[0], "m.lvpr", some, *words[1:], "--replay", table)
        assert said.startswith("g.lvpg: has 8 queries, but 9 are asked; give no more, or write it again")


def test_another_model_s_table_is_refused(table: Path) -> None:
    run("remove", "m.lvpr", "7", "-o", "n.lvpr")
    for command in ("query", "eval", "verify"):
        said = fails(command, "n.lvpr", "query", "--replay", table)
        assert said.startswith("g.lvpg: was written with another model (other weights or inputs)")


def test_a_table_of_the_same_map_in_other_bits_says_so_and_how_to_write_one(table: Path) -> None:
    run("deploy", "m.lvpr", "--target", "loihi2", "--weight-bits", 2, "-o", "b")
    run("query", "b", "query", "--learn", "--motion", "any", "-o", "b.csv", "--gains", "h.lvpg")
    for model, other in (("b", table), ("m.lvpr", "h.lvpg")):
        for command in ("query", "eval", "verify"):
            assert fails(command, model, "query", "--replay", other) == (
                f"{other}: was written with another network of the same map (deploy changes bits, pruning and "
                "inhibition); write it again with this model, or with the bundle that deploy makes without --replay: "
                "query --learn --gains"
            )
    run("deploy", "m.lvpr", "--target", "loihi2", "--weight-bits", 2, "-o", "b", "--replay", "h.lvpg")
    run("query", "b", "query", "--replay", "b/host/gains.lvpg", "--motion", "any", "-o", "again.csv")
    assert Path("again.csv").read_bytes() == Path("b.csv").read_bytes()


def test_a_map_that_learned_otherwise_is_another_model(table: Path) -> None:
    model = integer_model(load("m.lvpr"), "a test")
    same = dataclasses.replace(model, config=update(model.config, {"network": {"prune": 0.5}}))
    assert map_of(same) == map_of(model) == gain_table.load(table).map_of
    others = (
        {"config": update(model.config, {"seed": 1})},
        {"activity": model.activity * np.float32(2)},
        {"stretches": (*model.stretches, *model.stretches)},
    )
    assert len({map_of(dataclasses.replace(model, **other)) for other in others} | {map_of(model)}) == 4


def test_a_file_that_is_no_table_is_named(table: Path) -> None:
    words = ("query", "m.lvpr", "query", "--replay", table)
    whole = table.read_bytes()
    header, arrays = container.load(table, "gain table")
    for change, what in (
        ({"gains": arrays["gains"] + np.uint8(1)}, "gains with values"),
        ({"epoch": arrays["epoch"] + np.int32(1)}, "epoch with values"),
        ({"epoch": arrays["epoch"][1:]}, "epoch of shape"),
        ({"bias": arrays["bias"].astype(np.int64)}, "bias of type"),
        ({"bias": arrays["bias"][0]}, "bias"),
        ({"images": arrays["images"][1:]}, "images of shape"),
    ):
        container.save(table, "gain table", header, {**arrays, **change})
        assert f"g.lvpg: the gain table has no valid {what}" in fails(*words)
    for name in ("network_of", "map_of"):
        container.save(table, "gain table", {**header, name: "x"}, arrays)
        assert f"g.lvpg: the gain table has no valid {name}; write it again" in fails(*words)
    container.save(table, "gain table", header, {**arrays, "bias": arrays["bias"][:, 1:]})
    assert fails(*words).startswith("g.lvpg: does not hold what its model takes (biases of type int32 and shape (8, 7)")
    container.save(table, "gain table", header, {**arrays, "gains": arrays["gains"][:, 1:]})
    assert fails(*words).startswith("g.lvpg: does not hold what its model takes (gains of type uint8")
    container.save(table, "gain table", header, {**arrays, "bias": np.full_like(arrays["bias"], 1 << 18)})
    assert "makes its neuron spike without input" in fails(*words)
    table.write_bytes(whole[:-9])
    assert "g.lvpg: the gain table is damaged" in fails(*words)
    assert "is a 'lava-vpr model 1' file" in fails(*words[:-1], "m.lvpr")
    assert "no.lvpg: the gain table cannot be read" in fails(*words[:-1], "no.lvpg")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--gains", "h.lvpg"), "give one of them"),
        (("--replay", "g.lvpg", "--gains", "h.lvpg"), "give one of them"),
        (("--replay", "g.lvpg", "--learn"), "give it without --learn"),
        (("--replay", "g.lvpg", "--adapt", "30"), "give it without --adapt"),
    ],
    ids=lambda words: " ".join(words) if isinstance(words, tuple) else None,
)
def test_what_does_not_go_together(table: Path, words: tuple[str, ...], said: str) -> None:
    for command in ("query", "eval"):
        assert said in " ".join(fails(command, "m.lvpr", "query", *words, code=2).split())
    assert not Path("h.lvpg").exists()


def test_a_table_replaces_no_input(here: Path) -> None:
    for command in ("query", "eval"):
        said = fails(command, "m.lvpr", "query", "--learn", "--gains", "m.lvpr")
        assert said.startswith("m.lvpr: is also an input")
