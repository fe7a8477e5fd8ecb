"""The program for Kapoho Bay: what it draws, unpacks and configures, and that the stand-in board counts as the host."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.boards import host_programs
from support.boards.host_programs import Made, answers, write_queries
from support.boards.kapoho_board import (
    LAYOUTS,
    Board,
    Ended,
    altered,
    child,
    edited,
    layout,
    make,
    plan_by_hand,
    random_network,
)
from support.common.small_models import small_model

from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.deploy.bundle.targets import PROGRAMS
from lava_vpr.deploy.registers.core_images import core_images
from lava_vpr.deploy.registers.synapse_memory import unpack
from lava_vpr.deploy.registers.synapses import SynapseFormat
from lava_vpr.engine.inference import biases, fixed
from lava_vpr.engine.inference.biases import bias_registers, held_biases
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.rates import draw_spikes

SLOW = settings(deadline=None, max_examples=8, derandomize=True)


MODES: dict[str, dict[str, Any]] = {
    "injected": {},
    "regular": {"regular": True},
    "bias": {"regular": True, "bias_input": True},
}
OFF = {"regular": False, "bias_input": False}


@pytest.fixture(scope="module", params=["injected", "bias"])
def two_chips(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A network on two chips; never written to."""
    return make(tmp_path_factory.mktemp("made"), layout("two chips", random_network(**MODES[request.param])))


def test_the_program_needs_python_3_6_and_numpy_only() -> None:
    known = {"argparse", "contextlib", "hashlib", "importlib", "io", "itertools", "json", "os", "platform", "re"}
    known |= {"shutil", "signal", "subprocess", "sys", "tempfile"}
    others = host_programs.imported("kapoho_bay", (3, 6)) - known
    assert others == {"math", "numpy", "nxsdk", "threading", "time", "traceback", "types", "typing", "zlib"}


def test_the_chips_program_and_the_host_number_alike(program: Any) -> None:
    text, packets = (PROGRAMS / "kapoho_bay" / "embedded.c").read_text(), program.packets
    enums = [re.findall(r"LV_(\w+)", body) for body in re.findall(r"enum \{(.*?)\}", text, re.DOTALL)]
    kinds, words, faults = enums[0], enums[1], enums[2]
    assert [getattr(packets, name) for name in kinds] == list(range(1, 8))
    assert [getattr(packets, name) for name in words[:-2]] == list(range(8))
    assert [name.removeprefix("BAD_").lower() for name in faults[2:]] == list(packets.FAULTS[2:])
    assert f"LV_MAGIC {packets.MAGIC:#x}" in text
    assert text.count('#include "embedded.h"') == 1


@SLOW
@given(st.integers(0, 2**64 - 1), st.integers(1, 40), st.integers(1, 30))
def test_input_is_the_encoders(program: Any, key: int, inputs: int, steps: int) -> None:
    rates = np.random.default_rng(inputs).integers(0, 1 << 16, inputs).astype(np.uint16)
    own = program.board_input
    assert np.array_equal(own.draw_spikes(rates, key, steps), draw_spikes(rates, key, steps))
    regular = own.regular_spikes(rates, key, steps, own.LEVEL)
    assert regular.dtype == np.bool_
    assert np.array_equal(regular, biases.bias_input_spikes(rates, key, steps))
    for found, other in zip(own.biases(rates, own.LEVEL), biases.biases(rates), strict=True):
        assert np.array_equal(found, other)
    assert np.array_equal(own.phases(key, inputs, own.LEVEL), biases.start_membranes(key, inputs))
    assert own.LEVEL == biases.LEVEL


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("dense", [0.0, 0.5, 1.0])
def test_words_are_unpacked_as_they_were_packed(program: Any, tmp_path: Path, dense: float, signed: bool) -> None:
    plan = layout("apart", random_network(inputs=150, neurons=10, signed=signed), dense)
    bundle = program.bundle_files.Bundle(str(make(tmp_path, plan).path), "kapoho-bay")
    network = program.board_network.Network(bundle)
    for image in core_images(plan):
        core = network.of[image.chip, image.core]
        known = image.registers["synapseFmt"]
        formats = [None if form is None else SynapseFormat.of(form, "") for form in known]
        rows = unpack(image.synapses, image.axons_in, formats, len(image.compartments))
        for axon, row in enumerate(core.row_of_axon.reshape(-1)):
            number, compartments, weights = core.rows[row]
            own = slice(rows.starts[axon], rows.starts[axon + 1])
            assert number == rows.formats[axon]
            assert compartments == rows.compartments[own].tolist()
            form = known[number]
            worth = np.array(weights) * 2.0 ** (6 + form["wgtExp"])
            assert np.array_equal(worth, rows.currents(formats)[own])


def presented_biases(network: FixedNetwork, n: int) -> NDArray[np.int32]:
    """Biases of ``n`` queries, of both signs, with exponents that differ."""
    rng = np.random.default_rng(7)
    wanted = rng.integers(-network.highest_bias, network.highest_bias + 1, (n, network.neurons))
    wanted[::2, 0] = -9001
    return held_biases(wanted)


@pytest.mark.quick(8)
@pytest.mark.parametrize("simulate", [False, True])
@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("mode", MODES)
def test_the_board_and_its_registers_in_numpy_count_as_the_host(
    board: Board, tmp_path: Path, name: str, mode: str, simulate: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The references, then queries that each bring biases, in batches, then the references again."""
    if name == "leaves":
        monkeypatch.setattr(fixed, "FAN_IN", 4)
        monkeypatch.setattr(fixed, "DIRECT", 9)
    if simulate:
        monkeypatch.setitem(sys.modules, "nxsdk", None)  # there is none
    dense = float((mode == "bias") != (name == "apart"))
    network = random_network(3, signed=mode == "regular" or name == "leaves", threshold=30, **MODES[mode])
    made = make(tmp_path, layout(name, network, dense=dense))
    assert (network.leaves, network.relayed) == ((3, mode != "bias") if name == "leaves" else (0, False))
    assert network.bias.any()
    assert made.counts.sum() > 20
    where = ["--simulate"] * simulate
    equal = f"equal: 5 references, 50 counts, {made.counts.sum()} spikes of exc\n"
    assert board.run(made, "--self-test", *where) == Ended(0, equal, "")
    biases = presented_biases(network, 5)
    assert len(set(bias_registers(biases)[1].tolist())) > 1
    queries = write_queries(tmp_path / "queries", made.rates, made.keys, biases)
    words = ("--queries", queries, "--out", tmp_path / "out", "--batch", 2, *where)
    assert board.run(made, *words) == Ended(0, "5 of 5 queries answered\n", "")
    expected, _, _ = count_spikes(network, made.rates, made.keys, bias=biases)
    counts, done, _ = answers(tmp_path / "out")
    assert done.all()
    assert np.array_equal(counts, expected)
    assert expected.sum() > 10
    assert not np.array_equal(expected, made.counts)
    assert board.run(made, "--self-test", *where).code == 0  # without them the neurons have their own again
    if simulate:
        assert board.run(made, "--simulate", "--check").out.splitlines()[1].startswith("ready to simulate: ")


def test_biases_that_no_register_holds_are_refused(board: Board, tmp_path: Path) -> None:
    network = random_network(3, signed=True, threshold=30)
    made = make(tmp_path, layout("one core", network))
    rates, keys = (np.load(made.path / "host" / f"{what}.npy") for what in ("rates", "keys"))
    queries = write_queries(tmp_path / "queries", rates, keys, presented_biases(network, len(keys)))
    good = {name: np.load(queries / f"{name}.npy") for name in ("biases", "exponents")}
    for name, wrong, said in (
        ("biases", good["biases"][:, 1:], "biases.npy is int32 (5, 9), but must be int32 (5, 10)"),
        ("biases", np.full_like(good["biases"], -4096), "biases.npy holds a value outside -4095..4095"),
        ("exponents", good["exponents"] + 8, "exponents.npy holds a value outside 0..7"),
        ("exponents", good["exponents"].astype(np.int64), "exponents.npy is int64 (5,), but must be int32 (5,)"),
    ):
        np.save(queries / f"{name}.npy", wrong)
        ended = board.run(made, "--queries", queries, "--out", tmp_path / "out")
        assert ended.code == 1
        assert said in ended.err
        np.save(queries / f"{name}.npy", good[name])


def test_more_neurons_than_a_packet_holds(board: Board, tmp_path: Path) -> None:
    network = random_network(5, inputs=40, neurons=70, threshold=60, inhibition=3, **MODES["bias"])
    plan = plan_by_hand(network, {(1, 0): [("exc", 0, 70), ("inh", 0, 1), ("inputs", 0, 40)]})
    made = make(tmp_path, plan, images=3)
    ended = board.run(made, "--self-test")
    assert (ended.code, ended.err) == (0, "")
    assert made.counts[:, 60:].sum() > 0


def test_queries_in_batches(board: Board, two_chips: Made, tmp_path: Path) -> None:
    queries = write_queries(tmp_path / "q", two_chips.rates, two_chips.keys)
    log = tmp_path / "log"
    ended = board.run(two_chips, "--queries", queries, "--out", tmp_path / "r", "--batch", 2, log=str(log))
    assert (ended.code, ended.out, ended.err) == (0, "5 of 5 queries answered\n", "")
    counts, done, status = answers(tmp_path / "r")
    assert counts.dtype == np.int32
    assert np.array_equal(counts, two_chips.counts)
    assert done.all()
    assert status == {"done": 5, "of": 5, "stage": None, "error": None}
    steps = two_chips.network.interval
    runs = [f"run {2 + n * steps}" for n in (2, 2, 1)]
    assert log.read_text().split("\n") == ["start", *(x for run in runs for x in (run, "finished")), "disconnect", ""]
    assert sorted(path.name for path in (tmp_path / "r").iterdir()) == ["counts.npy", "done.npy", "status.json"]


def test_no_query_is_no_work(board: Board, two_chips: Made, tmp_path: Path) -> None:
    queries = write_queries(tmp_path / "q", two_chips.rates[:0], two_chips.keys[:0])
    assert board.run(two_chips, "--queries", queries, "--out", tmp_path / "r").code == 0
    assert answers(tmp_path / "r")[0].shape == (0, 10)


def test_self_test_sums_the_images_of_a_place(board: Board, tmp_path: Path) -> None:
    made = make(tmp_path, layout("one core", random_network(1)), images=3, traverses=2)
    assert board.run(made, "--self-test").out.startswith("equal: 6 references, 30 counts")
    assert board.run(made, "--self-test", 5).out.startswith("equal: 5 references, 20 counts")
    ended = board.run(made, "--self-test", 3)
    assert (ended.code, ended.err) == (1, "the first 3 references are not all of any place; present more\n")


def test_self_test_tells_the_first_difference(board: Board, tmp_path: Path) -> None:
    made = make(tmp_path, layout("one core", random_network(1)))
    right = int(made.counts[1, 4])
    array_at = 128 + 4 * (4 * 5 + 1)  # neuron 4, place 1

    def more(content: bytes) -> bytes:
        return content[:array_at] + bytes([right + 1]) + content[array_at + 1 :]

    altered(made, "host/responses.npy", more)
    ended = board.run(made, "--self-test")
    said = f"neuron 4 counts {right} spikes for place 1 instead of {right + 1}; 1 of 50 counts differ"
    assert (ended.code, ended.err) == (1, f"self-test: {said}\n")


@pytest.mark.quick(1)
@pytest.mark.parametrize("mode", MODES)
def test_a_deployed_model(board: Board, tmp_path: Path, mode: str) -> None:
    model = small_model()
    network = replace(model.network, threshold=2 * model.network.threshold, **{**OFF, **MODES[mode]})
    way = {
        "input_mode": "bias" if network.bias_input else "injected",
        "trains": "regular" if network.regular else "poisson",
    }
    model = replace(model, network=network, config=update(model.config, {"network": way}))
    bundle = deploy(model, KAPOHO_BAY, tmp_path / "bundle", picture=False).bundle
    held = {name: data for name, data in bundle.files.items() if name.startswith("program/")}
    assert held == {f"program/{name}": data for name, data in host_programs.files("kapoho_bay").items()}
    clearing = bundle.manifest["clearing"]
    assert clearing["input_writes_per_query"] == 3 * network.input_compartments
    assert clearing["writes_per_query"] == 2 * network.neurons + 3 * network.input_compartments
    ended = board.run(Made(tmp_path / "bundle", network, *3 * [np.zeros(0)]), "--self-test", 2)
    assert (ended.code, ended.err) == (0, "")


WRONG: dict[str, tuple[str, str]] = {
    "decay": ("4096 - np", "4095 - np"),
    "threshold": ("np.int64) << 6", "np.int64) << 5"),
    "no reset": ("self.v[spikes] = 0", "self.v[spikes] -= self.level[spikes]"),
    "early": ("for place, axon in sent:", "for place, axon in sent[1:]:"),
    "sign": ("np.sign(values) * worth", "worth"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_simulation_is_seen(board: Board, tmp_path: Path, name: str) -> None:
    made = make(tmp_path, layout("one core", random_network(3, signed=True, threshold=30)))
    ended = edited(board, made, "simulated.py", *WRONG[name]).run(made, "--simulate", "--self-test")
    assert ended.code == 1
    assert "instead of" in ended.err or "a counter holds" in ended.err


MUTATIONS: dict[str, tuple[str, str, bool, str]] = {
    "no flush": ("nx_flush_core", "(void)", False, "registers were written and not flushed"),
    "no clearing": (".compartment, 0)", ".compartment, 5000)", False, "a counter holds"),
    "counters go on": (
        "lv_set_state(lv_counter_places[i].core, lv_counter_places[i].compartment, 0);",
        "continue;",
        False,
        "instead of",
    ),
    "another compartment": (
        "[lv_counter_places[i].compartment].V",
        "[lv_exc_places[i].compartment].V",
        False,
        "a counter holds",
    ),
    "read too early": (
        "    lv_collect();\n    lv_report();",
        "    lv_report();\n    lv_collect();",
        False,
        "instead of",
    ),
    "bias stays": ("lv_step == LV_STEPS - 1", "lv_step == LV_STEPS + 99", True, "instead of"),
    "bias too large": ("bias & 0xfff", "bias & 0x1fff", True, "does not fit its register"),
    "a threshold written": ("settings.Bias = bias & 0xfff;", "core->vth = bias;", True, "does not compile"),
    "profiles lost": ("= core->cx_cfg[lv_source_places[i].compartment];", "= {0};", True, "profile of a compartment"),
    "early silence": ("lv_step == LV_STEPS - 1", "lv_step == LV_STEPS / 2", True, "instead of"),
    "wrong axon": ("input][target];", "input][target] | 0x400;", False, "a spike came to input axon"),
    "wrong time": ("(uint16_t)s->time_step,", "(uint16_t)~s->time_step,", False, "a spike is sent in step"),
    "not sent": ("lv_received++;", "lv_received += input % 2;", False, "the chip took"),
    "another query": ("lv_query++;", "lv_query += 2;", False, "a packet came with query 2 instead of 3"),
    "a warning": ("(void)s;", "int unused;", False, "does not compile"),
}


@pytest.mark.quick(5)
@pytest.mark.parametrize("name", MUTATIONS)
def test_the_stand_in_sees_defects_of_the_chips_program(board: Board, tmp_path: Path, name: str) -> None:
    old, new, bias_input, said = MUTATIONS[name]
    made = make(tmp_path, layout("one core", random_network(1, regular=bias_input, bias_input=bias_input)), images=3)
    ended = edited(board, made, "embedded.c", old, new).run(made, "--self-test", "--timeout", 3)
    assert ended.code == 1
    assert said in ended.err, ended.err
    assert len(ended.err.splitlines()) == 1


EDITS: dict[str, tuple[str, str, str]] = {
    "no phase": ("own.cxMetaState[i // 4].configure", "dict", "phase0 is used but was not configured"),
    "no epoch": ("own.timeState[0].tepoch = 2", "pass", "delayBits or tepoch"),
    "no updates": ("own.numUpdates.configure", "dict", "numUpdates is used but was not configured"),
    "twice": ("in enumerate(weights):", "in 2 * list(enumerate(weights)):", "is written twice"),
    "a float": ("Wgt=weight", "Wgt=weight / 1", "is a float, not an integer"),
    "no sign": ("stored -= (stored", "stored -= 0 * (stored", "is not -256 to 255"),
    "not shifted": ("stored << REGISTER_BITS - weight_bits", "stored", "does not fit 4 bits"),
    "number for id": ("=self.core(chip, target).id", "=target", "leads nowhere"),
    "no such name": ("synapseLen =", "synapseLength =", "has no field synapseLength"),
    "another phase": ("EMBEDDED_MGMT,", "EMBEDDED_SPIKING,", "createSnip"),
}


@pytest.mark.parametrize("name", EDITS)
def test_the_stand_in_sees_defects_of_the_program(board: Board, tmp_path: Path, name: str) -> None:
    old, new, said = EDITS[name]
    made = make(tmp_path, layout("two chips", random_network()), images=2)
    (name,) = [file for file, content in host_programs.files("kapoho_bay").items() if old.encode() in content]
    ended = edited(board, made, name, old, new).run(made, "--self-test")
    assert ended.code == 1
    assert said in ended.err, ended.err


@pytest.mark.parametrize("two_chips", ["injected"], indirect=True)
def test_chips_that_step_together_are_not_sent_to_one_after_the_other(two_chips: Made) -> None:
    ended = child(two_chips, "--self-test", "--timeout", 0.5, before="board_device.CHUNK = board_link.CHUNK = 1000")
    assert ended.code == 1
    assert "did not finish within 0.5 s (0 of 5 queries answered)" in ended.err
