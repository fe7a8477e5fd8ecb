"""What Lava's run configurations select: on a chip nothing of the CPU, and equal spikes in simulation.

Selection is Lava's own code under its own `Loihi2HwCfg`. Which Processes of its library the closed lava-loihi has
models for is not known here but by public texts: `CHIP` names the row of the table of hardware for each, and a stand-in
has a model without content for these alone. So a Process counts as resolved when what is left of it is one of them.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lava.magma.core.model.sub.model import AbstractSubProcessModel
from numpy.typing import NDArray
from support.boards.loihi2_bundles import STANDIN
from support.lava.process_targets import MADE

from lava_vpr import processes
from lava_vpr.deploy.hardware.table import BELIEFS
from lava_vpr.errors import NetworkLimitError
from lava_vpr.isolated.runner import run_isolated

pytestmark = pytest.mark.lava

TARGETS = "support.lava.process_targets"
CHIP = {
    "lava.proc.lif.process.LIF": "LIF has a model for the chip",
    "lava.proc.lif.process.LIFReset": "Dense and LIFReset have models for the chip",
    "lava.proc.dense.process.Dense": "Dense and LIFReset have models for the chip",
    "lava.proc.sparse.process.Sparse": "Sparse has a model for the chip",
    "lava.proc.dense.process.LearningDense": "LearningDense has a model for the chip",
}
"""The Processes of Lava's library that count as resolved, and the row of the table of hardware that says why."""

BESIDE = ("PoissonEncoder", "RegularEncoder", "SpikeCounter")
"""Processes that run in Python beside the chip, behind the vendor's adapters."""

NOT_FOR_A_BOARD = (
    "FusedPlaceNetwork",  # the host engine's kernel
    "ConductanceLIF",  # preset paper is float
    "ConductancePlaceNetwork",
    "ConductancePlastic",
    "DelayedDense",
    "FinePoissonEncoder",
    "LateralInhibition",
)
FOR_A_BOARD = {
    "BiasInputs": ("SubBiasInputsFixed", {"LIF"}),
    "DenseSynapses": ("SubDenseSynapsesFixed", {"Dense"}),
    "DenseSynapses, sparse": ("SubDenseSynapsesFixed", {"Sparse"}),
    "ExcitatoryLIF": ("SubExcitatoryLIFFixed", {"LIFReset"}),
    "ExcitatoryLIF, never reset": ("SubExcitatoryLIFFixed", {"LIF"}),
    "InhibitoryLIF": ("SubInhibitoryLIFFixed", {"LIFReset"}),
    "OneToOne": ("SubOneToOneFixed", {"Sparse"}),
    "SparseSynapses": ("SubSparseSynapsesFixed", {"Sparse"}),
    "PlasticDense": ("SubPlasticDenseFixed", {"LearningDense"}),
    "FrontEndNetwork": ("SubFrontEndNetwork", {"LIFReset", "Sparse"}),
    "InputGains": ("SubInputGains", {"LIFReset", "Sparse"}),
    "PlaceNetwork": ("SubPlaceNetwork", {"Dense", "LIFReset"}),
    "PlaceNetwork, leaves and relays": ("SubPlaceNetwork", {"Dense", "LIFReset", "Sparse"}),
    "LearningPlaceNetwork": ("SubLearningPlaceNetwork", {"Dense", "LearningDense", "LIFReset", "Sparse"}),
}
"""What docs/lava.md says is selected: the SubProcessModel, and the library's Processes that it is made of."""


def on_a_board(target: str, standin: Path = STANDIN, **options: Any) -> list[list[str]]:
    """The ``rows`` of a target in a child that has lava-loihi's stand-in on its search path."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(standin))
        patch.setenv("NXSDKHOST", "10.0.0.2")
        rows = run_isolated(f"{TARGETS}:{target}", {}, options, timeout=240)["rows"]
    return [[str(word) for word in row] for row in rows]


def not_on_the_chip(rows: list[list[str]]) -> list[str]:
    """Whatever ends elsewhere than in a model of the chip for a Process of `CHIP`."""
    return [" ".join(row) for row in rows if row[4] != "chip" or row[2] not in CHIP]


def test_nothing_that_a_board_needs_ends_on_the_cpu() -> None:
    rows = on_a_board("resolved", names=list(FOR_A_BOARD), sub=True)
    assert not_on_the_chip(rows) == []
    for name, (own, parts) in FOR_A_BOARD.items():
        mine = [row for row in rows if row[0] == name]
        assert {row[1] for row in mine} == {own}
        assert {row[2].rsplit(".", 1)[1] for row in mine} == parts
    for row in rows:  # shown with pytest's -s
        print("{:32} {:24} {:42} {:22} {}".format(*row))


def test_what_counts_as_resolved_has_a_public_source() -> None:
    assert all(BELIEFS[row].source for row in CHIP.values())
    assert not BELIEFS["LearningDense with LIFReset runs on the chip"].source


def test_every_process_is_for_a_board_or_said_not_to_be() -> None:
    shown = {name.split(",")[0] for name in FOR_A_BOARD}
    assert sorted([*shown, *BESIDE, *NOT_FOR_A_BOARD]) == sorted(processes.__all__)
    assert set(MADE) == {*FOR_A_BOARD, *BESIDE, "FusedPlaceNetwork"}


@pytest.mark.slow
def test_without_asking_for_sub_process_models_all_end_on_the_cpu() -> None:
    """Lava does so without a word; the walk sees it."""
    rows = on_a_board("resolved", names=list(FOR_A_BOARD), sub=False)
    assert len(not_on_the_chip(rows)) == len(rows)
    assert {row[4] for row in rows} == {"CPU"}
    ((said,),) = on_a_board("refused")
    assert said.startswith(
        "Loihi2HwCfg would run on the CPU: InhibitoryLIF Process_0 (PyInhibitoryLIFFloat); pass select_sub"
    )


def test_the_walk_sees_a_lava_loihi_that_lacks_a_model(tmp_path: Path) -> None:
    lacking = shutil.copytree(STANDIN, tmp_path / "standin")
    (lacking / "lava" / "proc" / "sparse" / "ncmodel.py").unlink()
    rows = on_a_board("resolved", lacking, names=["OneToOne", "PlaceNetwork"], sub=True)
    (said,) = not_on_the_chip(rows)
    assert said.startswith("OneToOne SubOneToOneFixed lava.proc.sparse.process.Sparse PySparseModel")


def test_those_beside_the_chip_and_the_fused_network_stay_on_the_cpu() -> None:
    rows = on_a_board("resolved", names=[*BESIDE, "FusedPlaceNetwork"], sub=True)
    assert [(row[0], row[4]) for row in rows] == [(name, "CPU") for name in (*BESIDE, "FusedPlaceNetwork")]


@pytest.mark.quick(1)
@pytest.mark.parametrize("bias_input", [True, False], ids=["inputs on the chip", "injected"])
def test_a_whole_network_compiles_with_nothing_else_on_the_cpu(bias_input: bool) -> None:
    rows = on_a_board("compiled", bias_input=bias_input)
    kinds = {place: sorted({row[0] for row in rows if row[2] == place}) for place in ("chip", "embedded", "CPU")}
    own = ["LIF"] if bias_input else []
    assert kinds["chip"] == sorted(["Dense", "LIFReset", *own])
    assert kinds["embedded"] == (["NxToPyAdapter"] if bias_input else ["NxToPyAdapter", "PyToNxAdapter"])
    assert kinds["CPU"] == (["SpikeCounter"] if bias_input else ["RegularEncoder", "SpikeCounter"])


def test_a_decay_that_the_chip_cannot_hold_is_refused_there() -> None:
    """Lava's simulated LIF takes 4096, which has 13 bits; without memory the network still equals the host's."""
    with pytest.raises(NetworkLimitError, match=r"^decay is 4096, but must be in 0\.\.4095 on a board"):
        on_a_board("compiled", bias_input=True, decay=4096)


def test_a_run_in_simulation_selects_by_tag_and_kind() -> None:
    leaves = [name for name in MADE if not name.startswith(("Place", "Learning", "Fused", "FrontEnd", "InputGains"))]
    found = run_isolated(f"{TARGETS}:selected_in_simulation", {}, {"names": leaves}, timeout=120)["rows"]
    assert len(found) == 4 * len(leaves)
    for name, tag, sub, model, tags in found:
        assert tag in tags.split(), (name, model)
        library = sub == "True" and name not in BESIDE
        kind = "" if name in BESIDE else "Fixed" if tag == "fixed_pt" else "Float"  # beside the chip: one for both
        assert model == f"{'Sub' if library else 'Py'}{name.partition(',')[0]}{kind}", (name, tag)


def plastic(**options: Any) -> dict[str, NDArray[Any]]:
    rng = np.random.default_rng(options["rng_seed"])
    arrays = {
        "pre": rng.random((70, 12)) < 0.25,
        "post": rng.random((70, 5)) < 0.2,
        "weights": rng.integers(0, 200, (5, 12)),
    }
    return run_isolated(f"{TARGETS}:plastic", arrays, {"tag": "fixed_pt", **options}, timeout=120)


@pytest.mark.parametrize(
    ("weight_exp", "rng_seed"), [(-2, 2), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((0, 1), (1, 3)))]
)
def test_learning_synapses_are_the_librarys(weight_exp: int, rng_seed: int) -> None:
    ours, library = (plastic(weight_exp=weight_exp, rng_seed=rng_seed, sub=sub) for sub in (False, True))
    assert ours["raster"].sum() > 10
    for name in ("raster", "weights", "x1"):
        assert np.array_equal(ours[name], library[name]), name


def test_learning_in_the_librarys_floating_point_is_refused() -> None:
    with pytest.raises(NetworkLimitError, match=r"^PlasticDense: Lava's floating-point LearningDense scales a rule"):
        plastic(weight_exp=0, rng_seed=1, sub=True, tag="floating_pt")


def test_sub_process_models_come_first() -> None:
    """Lava 0.10 confuses positions among them with positions among all models."""
    for name in (
        "BiasInputs",
        "DenseSynapses",
        "ExcitatoryLIF",
        "InhibitoryLIF",
        "OneToOne",
        "PlasticDense",
        "SparseSynapses",
    ):
        process = getattr(processes, name)
        kinds = [
            issubclass(model, AbstractSubProcessModel)
            for model in vars(sys.modules[process.__module__]).values()
            if getattr(model, "implements_process", None) is process
        ]
        assert kinds == [True, True, False, False], name
