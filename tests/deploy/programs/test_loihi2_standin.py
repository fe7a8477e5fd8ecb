"""The backend ``loihi2`` on a stand-in for lava-loihi, and what the stand-in refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.boards.loihi2_bundles import (
    STANDIN,
    asked,
)
from support.common.small_models import small_model

from lava_vpr.backends import registry as backends
from lava_vpr.backends.interface import Presentations
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import LavaRunError
from lava_vpr.isolated.runner import run_isolated


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., None]:
    """lava-loihi's stand-in on the search path, which the runner's processes inherit; sets its options."""
    monkeypatch.syspath_prepend(str(STANDIN))
    monkeypatch.setenv("NXSDKHOST", "10.0.0.2")

    def options(**asked_for: Any) -> None:
        monkeypatch.setenv("STANDIN_LOIHI", str(asked(tmp_path, **asked_for)))

    return options


@pytest.mark.lava
@pytest.mark.parametrize("way", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_backend_counts_what_the_host_counts(board: Callable[..., None], way: int, tmp_path: Path) -> None:
    model = small_model()
    network = replace(model.network, regular=model.network.regular or way, bias_input=way)
    model = replace(model, network=network)
    np.save(tmp_path / "weights.npy", model.network.stored[0])
    board(weights=str(tmp_path / "weights.npy"), log=str(tmp_path / "log"))
    shown = Presentations(query_rates(model.activity, model.config)[:3], 0)
    host, chip = backends.get("host"), backends.get("loihi2")
    wanted = host.count_spikes(model, shown)
    found = chip.count_spikes(model, shown)
    assert wanted[0].any()
    assert np.array_equal(found[0], wanted[0])
    assert found[1] == wanted[1]
    trains = chip.trains(model, shown)
    expected = host.trains(model, shown)
    assert all(np.array_equal(getattr(trains, name), getattr(expected, name)) for name in trains.POPULATIONS)
    log = (tmp_path / "log").read_text(encoding="utf-8").splitlines()
    assert len(log) == 4
    assert log[1] == f"ran {3 * network.interval} steps"


@pytest.mark.lava
def test_the_backend_says_that_the_board_fails(board: Callable[..., None]) -> None:
    board(fault="raise", step=70)
    model = small_model()
    rates = query_rates(model.activity, model.config)[:2]
    with pytest.raises(LavaRunError, match="the board does not answer any more"):
        backends.get("loihi2").count_spikes(model, Presentations(rates, 0))


@pytest.mark.lava
def test_the_standin_refuses_what_the_chip_cannot_hold(board: Callable[..., None]) -> None:
    said = {name: str(text) for name, text in run_isolated("standin_chip.trials:refusals", {}, timeout=120).items()}
    accepted = {name for name, text in said.items() if text == "nothing"}
    assert accepted == {"a good neuron", "good synapses", "256 steps"}
    begin = {
        "du": "du 4,096 is not 0 to 4,095 (lava-nc 0.10, ",
        "vth": "vth 131,072 is not 0 to 131,071 (lava-nc 0.10, ",
        "fraction": "dv is float64, not a whole number",
        "bias": "bias_mant 4,096 is not -4,096 to 4,095 (lava-nc 0.10, ",
        "offset": "step of the first reset (reset_offset) 3 is not 1 (lava-dl at d825ac5, ",
        "353 steps": "reset_interval 353 is not a power of two (lava-dl at d825ac5, ",
        "33 steps": "reset_interval 33 is not a power of two (lava-dl at d825ac5, ",
        "131072 steps": "the longest interval between two resets 131,072 is more than 65,536 (unproven: ",
        "sign": "sign mode None leaves it to Lava to choose",
        "weight": "weights of sign mode EXCITATORY 256 is not 0 to 255 (lava-nc 0.10, ",
        "bits": "weights have more than 5 bits, the lowest would be lost",
        "exponent": "weight_exp -8 is not -7 to 7 (unproven: ",
        "foreign": "RingBuffer is not a Process of Lava's library that the stand-in knows",
        "written": "v 8,388,608 is not -8,388,607 to 8,388,607 (lava-nc 0.10, ",
    }
    assert set(said) == accepted | set(begin)
    for name, text in begin.items():
        assert said[name].startswith(text), said[name]
