"""The comparison of exported graphs with snnTorch: what it says of spikes that differ, and how it reads them back."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import nir
import numpy as np
import pytest
from support.common.small_models import encoded, small_model

from benchmarks.exchange import compare
from benchmarks.exchange.compare import CaseSpikes, ExchangeCase, case_spikes, failures, row
from benchmarks.exchange.literal import spikes_of
from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.exchange.nir_writing import graph_of
from lava_vpr.model import integer_model

ECHO = """
import sys
from pathlib import Path
import numpy as np
for path in Path(sys.argv[-1]).glob("*.trains.npz"):
    few = np.zeros((8, 128, 2), np.uint8)
    np.savez(str(path).replace(".trains", ".result"), spikes=few, few=few[:2])
"""


def case(*, equal: bool = False) -> ExchangeCase:
    return ExchangeCase("small", integer_model(small_model(), "a test"), equal)


def same() -> CaseSpikes:
    spikes = np.random.default_rng(0).integers(0, 2, (8, 128, 9)).astype(np.uint8)
    return CaseSpikes(spikes, spikes, spikes[:2], spikes, spikes)


def test_a_graph_computes_what_the_network_computes(tmp_path: Path) -> None:
    """Its nodes, simulated from NIR's equations and with the truncation that the metadata tell, give every spike."""
    model = case().model
    nir.write(tmp_path / "net.nir", graph_of(model.network, 0.001))
    rates = np.random.default_rng(3).integers(0, 9000, (4, model.network.inputs)).astype(np.uint16)
    trains = HostBackend().trains(model, Presentations(rates, 7))
    spikes = spikes_of(nir.read(tmp_path / "net.nir"), trains.inputs, single=False, truncates=True)
    assert trains.exc.sum() > 20
    assert trains.inh.sum() > 5
    np.testing.assert_array_equal(spikes[:, :, : model.neurons], trains.exc)
    np.testing.assert_array_equal(spikes[:, :, model.neurons :], trains.inh)


def test_every_unattributed_difference_fails() -> None:
    spikes, other = same(), 1 - same().host
    assert failures(case(equal=True), spikes) == []
    assert failures(case(), replace(spikes, there=other, single=other)) == []
    for changed, said in (
        ({"there": other}, "snnTorch differs from NIR's equations in single precision"),
        ({"whole": other}, "the host differs from NIR's equations with truncation"),
        ({"there": other, "single": other}, "snnTorch differs from the host, though nothing is truncated"),
    ):
        assert f"small: {said}" in failures(case(equal=True), replace(spikes, **changed))
    silent = np.zeros_like(spikes.host)
    assert "no neuron spikes" in failures(case(), CaseSpikes(silent, silent, silent, silent, silent))[0]


def test_a_row_counts_what_differs() -> None:
    spikes = same()
    there = spikes.there.copy()
    there[3, :, 2] = 0
    cells = row(case(), replace(spikes, there=there))
    assert cells[3:6] == ["7 / 8", "1 / 64", f"{spikes.host[3, :, 2].sum()}"]
    assert cells[7:] == ["NO", "yes", "2 / 2"]


def test_a_simulator_without_spikes_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files go there and back; the literal model, which reads the graph, gives the host's spikes all the same."""
    monkeypatch.setattr(compare, "encoded", lambda season, encoder: encoded(8, seed=1))
    (tmp_path / "worker.py").write_text(ECHO)
    monkeypatch.setattr(compare, "PYTHON", Path(sys.executable))
    monkeypatch.setattr(compare, "WORKER", tmp_path / "worker.py")
    (spikes,) = case_spikes([case()], 8)
    assert spikes.host.sum() > 10
    assert not spikes.there.any()
    np.testing.assert_array_equal(spikes.whole, spikes.host)
    assert failures(case(), spikes) == ["small: snnTorch differs from NIR's equations in single precision"]
