"""The registers of bundles in nengo-loihi's emulator: what is asked of it, and that a wrong bit is seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.small_models import small_model

from benchmarks.oracles.inference import made_up
from benchmarks.oracles.registers import (
    MADE_UP,
    PYTHON,
    RegisterCase,
    bundle_case,
    compared,
    made_up_cases,
    main,
    put,
    written,
)
from lava_vpr.deploy.boards.board import BOARDS, KAPOHO_BAY
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.deploy.bundle.front_end import FRONT_END, front_end_files
from lava_vpr.engine.inference.biases import held_biases
from lava_vpr.engine.random import presentation_keys
from lava_vpr.errors import InputError
from lava_vpr.inputs.front_end import FrontEnd

needs_nengo = pytest.mark.skipif(
    not (PYTHON.parents[1] / ".installed").exists(), reason="nengo-loihi is not installed: make oracles"
)


def small_case(folder: Path, number: int = 2) -> RegisterCase:
    """One of the made-up networks."""
    return next(case for i, case in enumerate(made_up_cases(folder, 2)) if i == number)


def test_what_is_made_up_has_everything() -> None:
    assert {made.signed for _, made, _, _ in MADE_UP} == {dense for *_, dense in MADE_UP} == {False, True}
    assert {made.neurons > 1024 for _, made, _, _ in MADE_UP} == {made.neurons > 4096 for _, made, _, _ in MADE_UP}


@needs_nengo
def test_every_spike_is_the_hosts_and_a_wrong_bit_is_seen(tmp_path: Path) -> None:
    case = small_case(tmp_path)
    good = compared(case)
    assert (good.cores, good.differ, good.counters_differ) == (3, 0, 0)
    assert good.spikes > 10
    (first, *_) = sorted((case.folder / "cores").glob("*/compartments.npy"))
    table = np.load(first)
    table[0, 2] += 400  # the bias of the first neuron
    np.save(first, table)
    assert compared(case).differ > 0


@needs_nengo
def test_biases_are_those_of_each_presentation(tmp_path: Path) -> None:
    """Of a network with biases of its own that are given up for others, with another exponent."""
    network = made_up(MADE_UP[0][1], bias=True)
    rates = np.full((2, network.inputs), 6000, np.uint16)
    bias = held_biases(np.stack([network.bias // 2, -(network.bias >> 3) - 4097 * 2]))
    shown = (rates, presentation_keys(0, "query", np.arange(2)), bias)
    case = RegisterCase.of_network("biases", written(tmp_path, network, KAPOHO_BAY, False), network, *shown)
    good = compared(case)
    assert good.differ == good.counters_differ == 0
    assert case.films["exc"].sum() > 0
    assert compared(replace(case, mantissas={}, exponents={})).differ > 0


@needs_nengo
def test_every_spike_from_pixels_on_and_a_wrong_bit_is_seen(tmp_path: Path) -> None:
    spec = FrontEnd(width=8, levels=8, race=6, budget=20)
    files, facts = front_end_files(spec, KAPOHO_BAY, [])
    assert facts is not None
    grey = np.random.default_rng(0).integers(0, 256, (2, *spec.shape)).astype(np.uint8)
    written_to = {"pixels": grey.reshape(2, -1).astype(np.int32)}
    case = RegisterCase("from pixels", put(tmp_path, files) / FRONT_END, spec.trains(grey), mantissas=written_to)
    good = compared(case)
    assert (good.cores, good.differ) == (facts["cores"], 0)
    assert min(film.sum() for film in case.films.values()) > 0
    table = np.load(file := min(case.folder.glob("cores/*/compartments.npy")))  # of the clock, whose bias begins it
    table[0, 3] -= 2
    np.save(file, table)
    assert compared(case).differ > 0


@needs_nengo
def test_a_bundle_is_run_on_its_references(tmp_path: Path) -> None:
    deploy(small_model(), KAPOHO_BAY, tmp_path / "b", picture=False)
    done = CliRunner().invoke(main, [str(tmp_path / "b"), "--presentations", "2"])
    assert done.exit_code == 0, done.output


@needs_nengo
def test_a_row_that_is_none_is_a_reason(tmp_path: Path) -> None:
    case = small_case(tmp_path)
    (first, *_) = sorted((case.folder / "cores").glob("*/axons_in.npy"))
    table = np.load(first)
    table[0, 2] += 1
    np.save(first, table)
    with pytest.raises(InputError, match=r"nengo-loihi: .*its axon says"):
        compared(case)


@pytest.mark.parametrize("name", BOARDS)
def test_a_bundle_whose_inputs_integrate_a_bias_is_refused(tmp_path: Path, name: str) -> None:
    model = small_model()
    own = replace(model, network=replace(model.network, bias_input=True))
    own = replace(own, config=replace(own.config, network=replace(own.config.network, input_mode="bias")))
    deploy(own, BOARDS[name], tmp_path / "b", picture=False)
    with pytest.raises(InputError, match="is no bundle for Kapoho Bay whose input spikes are injected; deploy"):
        bundle_case(tmp_path / "b", 1)
    done = CliRunner().invoke(main, [str(tmp_path / "b")])
    assert done.exit_code == 1
    assert len(done.output.splitlines()) == 1
