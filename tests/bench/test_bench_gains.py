"""``lava-vpr bench`` with gains: what they take, of a drive that is replayed and of a season in the weights."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.common.commands import PLACES, content, fails, images, listed, run
from support.common.teaching import teach_quickly

from lava_vpr import load
from lava_vpr.bench import run as stages
from lava_vpr.bench.results import Measured
from lava_vpr.engine.gains import FULL
from lava_vpr.model import integer_model
from lava_vpr.season import table as gain_table
from lava_vpr.season.file import save, unlearned


@pytest.fixture
def table(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What a drive of several epochs was presented with; backends are not timed."""
    teach_quickly(monkeypatch)
    monkeypatch.setattr(stages, "measure", lambda queries, name, **_: Measured(name, "made up", milliseconds=(1.0,)))
    run("eval", "m.lvpr", "query", "--learn", "--gains", "g.lvpg")
    return Path("g.lvpg")


def written(*words: object) -> tuple[dict[str, Any], str]:
    """JSON and terminal text of a run."""
    text = run("bench", "m.lvpr", "query", *words, "--json", "b.json").stdout
    return json.loads(Path("b.json").read_text()), " ".join(text.split())


@pytest.mark.parametrize("views", [1, 3])
def test_a_replay_counts_products_of_the_host_and_registers_of_the_board(table: Path, views: int) -> None:
    values, text = written("--replay", table, "--query-views", views)
    model, known = integer_model(load("m.lvpr"), "a test"), gain_table.load(table)
    inputs = model.config.encoder.inputs
    multiplied = [inputs if (known.gains[k] < FULL).any() else 0 for k in known.epoch]
    assert 0 < sum(multiplied) < 8 * inputs
    assert values["gains"] == {
        "lessened": pytest.approx(np.mean([(known.gains[k] < FULL).sum() for k in known.epoch])),
        "products": pytest.approx(views * sum(multiplied) / 8),
        "epochs": len(known.gains),
        "gain_bytes": inputs,
        "bias_registers": views * PLACES,
        "bias_bytes": 4 * views * PLACES,
        "weights": 0,
        "weight_bytes": 0,
    }
    asked = values["asked"]
    assert asked["boards"]["loihi2"]["registers"] == values["gains"]["bias_registers"]
    assert asked["multiply_adds"] == model.network.weights.size
    assert asked["host_milliseconds"] > 0
    assert asked["adapt"] is None
    run("eval", "m.lvpr", "query", "--replay", table, "--query-views", views, "--json", "e.json")
    assert asked["adapted"] == json.loads(Path("e.json").read_text())["learned"]["contrast"]
    assert f"an epoch, of {len(known.gains)} in 8 queries" in text
    assert "is unproven" in text
    assert "under gains" in text


def test_all_the_energy_has_the_host_s_gains_and_the_board_s_biases(table: Path) -> None:
    values, text = written("--replay", table)
    ways, asked = values["energy"], values["asked"]
    assert list(ways) == ["kapoho-bay", "host", "kapoho-bay, gains", "host, gains", "cosine"]
    for name in ("kapoho-bay", "host"):
        plain, gained = ways[name], ways[f"{name}, gains"]
        more = gained["work_milliseconds"] - plain["work_milliseconds"]
        assert more == pytest.approx(asked["host_milliseconds"])
        assert gained["recall_at_1"] == asked["adapted"]["recall_at_1"]
    board, once = ways["kapoho-bay, gains"], ways["kapoho-bay"]
    assert board["dynamic_microjoules"]["nominal"] > once["dynamic_microjoules"]["nominal"]
    assert board["io_static_microjoules"]["nominal"] > once["io_static_microjoules"]["nominal"]
    assert "contrast, gains" in text


def test_a_season_in_the_weights_takes_nothing_of_a_query(table: Path) -> None:
    model = integer_model(load("m.lvpr"), "a test")
    gains = np.arange(model.config.encoder.inputs, dtype=np.uint8) % (FULL + 1)
    known = unlearned(model)
    known.gains[:] = gains
    save(known, Path("s.lvps"))
    values, text = written("--season", "s.lvps")
    found, weights = values["gains"], model.network.weights.size
    assert (found["lessened"], found["weights"]) == ((gains < FULL).sum(), weights)
    assert found["weight_bytes"] == -(-weights * (model.network.bits + 1) // 8)
    assert [found[name] for name in ("products", "gain_bytes", "bias_registers", "bias_bytes")] == [0] * 4
    assert values["asked"] is None
    assert "Gains are in the weights" in text
    plain, told = written()
    assert "gains" not in plain
    assert "gains take" not in told


def test_what_cannot_be_replayed_is_refused(table: Path) -> None:
    run("remove", "m.lvpr", "7", "-o", "n.lvpr")
    some = listed("some.txt", [*images("query")[1:], images("query")[0]])
    before, words = content(Path()), ("--replay", table, "--json", "b.json")
    said = fails("bench", "m.lvpr", some, *words)
    assert said.startswith("g.lvpg: its query 0 is another image than place_00001.png")
    assert fails("bench", "n.lvpr", "query", *words).startswith("g.lvpg: was written with another model")
    assert "no.lvpg: the gain table cannot be read" in fails("bench", "m.lvpr", "query", "--replay", "no.lvpg")
    assert "is also an input" in fails("bench", "m.lvpr", "query", "--replay", table, "--json", table)
    for other in (("--adapt", 4), ("--season", table)):
        assert "give it without" in " ".join(fails("bench", "m.lvpr", "query", *words, *other, code=2).split())
    assert content(Path()) == before
