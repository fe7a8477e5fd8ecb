"""The host's traffic for a query: as many packets as the host program sends."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.boards.host_programs import write_queries
from support.boards.kapoho_board import Board, layout, make, random_network
from support.boards.plans import busy_plan, trains_of

from lava_vpr import loihi
from lava_vpr.deploy.boards.constants import LOIHI_1
from lava_vpr.deploy.cost import embedded
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.encoding import draw_trains
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.presentations import Trains


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
