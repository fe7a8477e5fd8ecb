"""What the embedded program accesses and the host program sends for a query: as on the stand-in boards, and what that
takes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.boards.host_programs import write_queries
from support.boards.kapoho_board import Board, layout, make, random_network
from support.boards.plans import busy_plan, trains_of

from lava_vpr import loihi
from lava_vpr.deploy.boards.constants import LOIHI_1
from lava_vpr.deploy.cost import embedded
from lava_vpr.deploy.cost.embedded import Accesses
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.presentations import Trains
from lava_vpr.engine.rates import draw_trains


@pytest.mark.parametrize("bias_input", [False, True])
@pytest.mark.parametrize("name", ["one core", "two chips", "apart"])
def test_tables_take_what_those_of_the_program_take(program: Any, tmp_path: Path, name: str, bias_input: bool) -> None:
    """Without the element of zeros that C wants of an empty table."""
    plan = layout(name, random_network(bias_input=bias_input, regular=bias_input))
    bundle = program.bundle_files.Bundle(str(make(tmp_path, plan).path), "kapoho-bay")
    network, (most_bytes, masks) = program.board_network.Network(bundle), plan.embedded_tables
    for ways, bytes_ in ((frozenset(), most_bytes), (frozenset({"masks"}), masks)):
        network.ways = ways
        most = max(program.chip_program.table_bytes(network, chip) for chip in network.chips)
        assert 0 <= most - bytes_ <= 32
    assert masks <= most_bytes


@pytest.mark.quick(4)
@pytest.mark.parametrize("bias_input", [False, True])
@pytest.mark.parametrize("name", ["one core", "two chips"])
def test_registers_are_those_that_the_program_accesses(
    board: Board, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, bias_input: bool
) -> None:
    network = random_network(bias_input=bias_input, regular=bias_input)
    plan = layout(name, network)
    made = make(tmp_path, plan)
    from nxsdk_standin import snips  # the stand-in is on the path only here

    kept: dict[int, snips.Snip] = {}
    compile_first = snips.Snip.compile

    def compiled(self: snips.Snip) -> None:
        kept[self.chip.number] = self
        compile_first(self)

    monkeypatch.setattr(snips.Snip, "compile", compiled)
    calls = []
    for queries in (1, 2):
        folder = write_queries(tmp_path / f"q{queries}", made.rates[:queries], made.keys[:queries])
        assert board.run(made, "--queries", folder, "--out", tmp_path / f"out{queries}").code == 0
        calls.append({chip: Counter(snip.calls) for chip, snip in kept.items()})
    trains = draw_trains(made.rates, made.keys, network.steps, network.interval, regular=network.regular)
    film = count_spikes(network, made.rates, made.keys, raster=True)[2]
    in_steps = embedded._in_steps(plan, count_events(plan, Trains(film, trains)))
    between = embedded.between_queries(plan)
    assert sorted(between) == sorted(kept)
    for (chip, accesses), (registers, _) in zip(sorted(between.items()), in_steps, strict=True):
        more = {kind: calls[1][chip][kind] - calls[0][chip][kind] for kind in ("touch", "flush", "spike")}
        inputs = sum(core.part("inputs").size for core in plan.cores if core.chip == chip)
        # A bias is read before it is written, twice a query.
        assert accesses.registers == more["touch"] + 2 * inputs + more["flush"]
        assert registers[1].sum() == more["spike"]
        assert (more["spike"] > 0) != bias_input


def test_words_of_packets() -> None:
    # A packet of 64 words is copied; 8 of its head and what it holds are summed, and that is used.
    assert embedded.received(0) == 0
    assert embedded.received(30) == 64 + 8 + 60
    assert embedded.received(57) == 2 * (64 + 8) + 114
    # Whoever has nothing to say sends a packet, too; it is emptied first.
    assert embedded.sent(0) == 128 + 8
    assert embedded.sent(57) == 2 * (128 + 8) + 114


@pytest.mark.parametrize("bias_input", [False, True])
def test_the_busiest_chip_sets_the_time_of_a_step(bias_input: bool) -> None:
    plan = busy_plan(bias_input=bias_input)
    events = count_events(plan, trains_of(plan.network, 3, 1))
    found = embedded.step_microseconds(plan, events, LOIHI_1, "nominal")
    if bias_input:
        assert (found == 8 * 0.02).all()
        return
    chips, steps = np.array([core.chip for core in plan.cores]), plan.network.steps
    cores = [len({core.core for core in plan.cores if core.chip == chip and core.part("exc").size}) for chip in (0, 1)]
    for query in range(3):
        for step in range(events.steps):
            spikes = int(events.input_spikes[query, step])
            times = []
            for chip in (0, 1):
                sent = int(events.injected_messages[query, step, chips == chip].sum())
                words = 8 + (72 + (2 + cores[chip]) * spikes if step < steps else 0)
                times.append(0.1 * sent + 0.02 * words)
            assert found[query, step] == pytest.approx(max(times))
    told = embedded.as_json(plan, events, LOIHI_1)
    assert told["step_microseconds"].nominal == pytest.approx(found.mean())  # type: ignore[attr-defined]
    assert told["step_microseconds"].low < found.mean() < told["step_microseconds"].high  # type: ignore[attr-defined]


def test_times_of_accesses() -> None:
    took = Accesses(3, 10).nanoseconds(LOIHI_1)
    assert (took.low, took.nominal, took.high) == (3 * 25 + 10 * 5, 3 * 100 + 10 * 20, 3 * 400 + 10 * 80)
    chips = {0: Accesses(1, 0), 1: Accesses(0, 6)}
    longest = embedded.milliseconds(chips, LOIHI_1)
    assert (longest.low, longest.nominal, longest.high) == (30e-6, 120e-6, 480e-6)
    assert embedded.milliseconds({}, LOIHI_1).high == 0


@pytest.mark.parametrize("relayed", [False, True])
def test_packets_are_those_of_the_host_program(relayed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fixed, "DIRECT", 8 if relayed else 1024)
    source = (Path(embedded.__file__).parents[1] / "programs" / "kapoho_bay" / "packets.py").read_text()
    words, payload = (int(value) for value in re.findall(r"WORDS, PAYLOAD, MAGIC = (\d+), (\d+),", source)[0])
    assert (loihi.PACKET_WORDS, loihi.PACKET_HEADER_WORDS) == (words, payload)
    plan = busy_plan(bias_input=False)
    counted = count_events(plan, trains_of(plan.network, 5, 4))
    spikes, chips = counted.input_spikes.sum() / 5, 2
    sent = spikes * (1 if relayed else chips)  # each to its relay's chip, or to both
    to_board, counts = embedded.host_milliseconds(plan, counted, LOIHI_1)
    found = to_board["injected"] + counts
    usb = 13.9e-3
    assert found.nominal == pytest.approx(usb * chips * (30 + 1), rel=0.01)
    assert found.high == pytest.approx(usb * (sent + 20), rel=0.01)
    assert found.low == pytest.approx(usb * chips * (-(-sent / chips // 56) + 1), rel=0.01)


@pytest.mark.parametrize(
    ("name", "bias_input"),
    [
        ("apart", False),
        pytest.param("two chips", True, marks=pytest.mark.slow),
        pytest.param("two chips", False, marks=pytest.mark.slow),
        pytest.param("apart", True, marks=pytest.mark.slow),
    ],
)
def test_the_host_program_sends_so_many_packets(
    board: Board, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, bias_input: bool
) -> None:
    plan = layout(name, random_network(bias_input=bias_input))
    made = make(tmp_path, plan)
    packets, link = [0], board.program.board_link.Link

    def counted(method: str, number: Callable[..., int]) -> None:
        original = getattr(link, method)

        def call(self: object, *given: Any, **named: Any) -> Any:
            packets[0] += number(*given)
            return original(self, *given, **named)

        monkeypatch.setattr(link, method, call)

    counted("_send", lambda kind, query, first, payloads, *_: len(payloads))
    counted("expect", lambda *_: 1)
    found = []
    for queries in (1, 2):
        folder = write_queries(tmp_path / f"q{queries}", made.rates[:queries], made.keys[:queries])
        packets[0] = 0
        ended = board.run(made, "--queries", folder, "--out", tmp_path / f"out{queries}")
        assert ended.code == 0, ended.err
        found.append(packets[0])
    trains = draw_trains(made.rates, made.keys, plan.network.steps, plan.network.interval, regular=plan.network.regular)
    film = count_spikes(plan.network, made.rates, made.keys, raster=True)[2]
    to_board, counts = embedded.host_milliseconds(plan, count_events(plan, Trains(film, trains)), LOIHI_1)
    messages = (next(iter(to_board.values())) + counts).nominal / loihi.KAPOHO_BAY_MESSAGE_US * 1e3
    assert found[1] - found[0] == pytest.approx(messages)
    assert messages > 0
