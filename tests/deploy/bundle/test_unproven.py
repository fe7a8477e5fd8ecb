"""What a bundle rests on that no public source shows: every such row of the table of hardware, by name."""

from __future__ import annotations

import json
from typing import Any

import pytest
from support.common.small_models import small_model

from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle.compression import Changes, adapted
from lava_vpr.deploy.bundle.deployment import contents
from lava_vpr.deploy.hardware.belief import Given, HardwareBelief
from lava_vpr.deploy.hardware.table import BELIEFS

KAPOHO_BAY = [
    "synapse memory that plans leave free",
    "rounding of decays",
    "dendriteSharedCfg.noiseExp0, noiseMantOffset0, noiseAtDendOrVm (left unwritten)",
    "synapseFmt.compression (rows with indices, of discrete axons)",
    "channel.write of messages of several words",
    "channel.probe",
    "cx_state, written",
    "memory of an embedded processor",
    "phases and accumulators stay as they are when states are cleared",
]
NARROW = ["synapseFmt.wgtBits (weights of fewer than 8 bits)", "Wgt with fewer bits: the upper ones"]
DENSE, BIAS_OF_CHIP = ["synapseFmt.idxBits (rows without indices)"], ["cx_cfg, written"]
LOIHI_2 = [
    "rounding of decays",
    "how a Loihi 2 core's memory divides into synapses, axons and states",
    "weight_exp",
]
LONG, LEARNED = ["the longest interval between two resets"], ["LearningDense with LIFReset runs on the chip"]
PAUSED = ["bias_mant, bias_exp and v are written while the run is paused"]
NO_BUNDLE = {
    "order of the fields in a synapse word",  # nothing breaks
    "spike counters of a chip",  # no bundle has a probe
    "power of a run",  # --power alone
    "Kapoho Bay has sensors of power",
    "Loihi2ExecutionTime takes t_start, t_end, buffer_size, bin_size",  # bench alone
}


def made(board: str, mode: str, bits: int = 3, **options: Any) -> tuple[list[str], str]:
    """What the manifest of a bundle of a small model names, and its README."""
    model = adapted(small_model(), BOARDS[board], Changes(weight_bits=bits, input_mode=mode)).model  # type: ignore[arg-type]
    manifest, files, _ = contents(model, BOARDS[board], picture=False, **options)
    return json.loads(json.dumps(manifest["unproven"])), files["README.md"].decode()


@pytest.mark.parametrize(
    ("board", "mode", "options", "rows"),
    [
        ("kapoho-bay", "injected", {"bits": 7}, KAPOHO_BAY),
        ("kapoho-bay", "injected", {"bits": 3}, [*KAPOHO_BAY, *NARROW]),
        ("kapoho-bay", "injected", {"bits": 3, "dense_rows": True}, [*KAPOHO_BAY, *NARROW, *DENSE]),
        ("kapoho-bay", "bias", {"bits": 7}, [*KAPOHO_BAY, *BIAS_OF_CHIP]),
        ("loihi2", "injected", {}, [*LOIHI_2, *LONG]),
        ("loihi2", "bias", {}, [*LOIHI_2, *LONG, *PAUSED]),
        ("loihi2", "bias", {"learning": True}, [*LOIHI_2, *LONG, *PAUSED, *LEARNED]),
    ],
)
def test_a_bundle_names_every_unproven_row_that_it_rests_on(
    board: str, mode: str, options: dict[str, Any], rows: list[str]
) -> None:
    named, readme = made(board, mode, **options)
    assert named == [name for name in BELIEFS if name in rows]
    assert sorted(named) == sorted(rows)
    for name in named:
        assert not BELIEFS[name].proven
        assert f"- {name}: if it is wrong, {BELIEFS[name].breaks}\n" in readme


def test_every_unproven_row_is_one_of_bundles_or_of_none() -> None:
    rows = {*KAPOHO_BAY, *NARROW, *DENSE, *BIAS_OF_CHIP, *LOIHI_2, *LONG, *LEARNED, *PAUSED}
    assert {row.name for row in BELIEFS.values() if not row.proven and row.kind != "figure"} == rows | NO_BUNDLE


def test_a_proven_row_is_not_rested_on() -> None:
    with pytest.raises(TypeError, match="a call: has a source, so no bundle is said to rest on it"):
        HardwareBelief("a call", "a chip", "call", Given("f"), None, "all", "a paper", rests=("Loihi 1",))
