"""The picture and the table of a deployment: what stands where, readable, the same bytes everywhere."""

from __future__ import annotations

import csv
import io
import itertools
import re
from functools import lru_cache
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from lava_vpr.cli.show.boards import placed, rests_on
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.boards.constants import Estimate
from lava_vpr.deploy.boards.memory import row_words
from lava_vpr.deploy.boards.plan import CorePlan, Load, Needs, Plan, PopulationName, PopulationPart, Times
from lava_vpr.deploy.show.drawing import COLOURS, MOST_CARDS, WIDTH, draw, figure_of
from lava_vpr.deploy.show.tables import busiest, core_table, in_short, rows_of, share, summary
from lava_vpr.engine.inference.fixed import FixedNetwork

SVG = "{http://www.w3.org/2000/svg}"


TIMES = Times(100, 500, Estimate(5.0, 11.6806, 34.06), Estimate(0.07, 0.15344, 1234.5))


def network(neurons: int, inputs: int = 120, bias_input: bool = False) -> FixedNetwork:
    rng = np.random.default_rng(neurons)
    weights = rng.integers(0, 8, (inputs, neurons)) * (rng.random((inputs, neurons)) < 0.3)
    weights[7] = 0
    bias = np.zeros(neurons, np.int32)
    return FixedNetwork(weights.astype(np.int16), bias, 3, False, 220, 20, 0, 137, 61, bias_input, bias_input)


def needs(board: Board, compartments: int, axons_in: int, axons_out: int, words: int) -> Needs:
    if not board.memory.public:
        return Needs(compartments, None, None, None, None, None, None)
    return Needs(compartments, axons_in, axons_out, words, 3, 2, 3)


@lru_cache(maxsize=16)
def plan(neurons: int, board: Board = KAPOHO_BAY, bias_input: bool = False, each: int = 100, every: int = 1) -> Plan:
    """A plain plan: ``each`` neurons on every ``every``-th core, then inhibitory ones, then inputs."""
    net = network(neurons, bias_input=bias_input)
    parts: list[list[tuple[PopulationName, int, int]]] = []
    for first in range(0, neurons, each):
        size = min(each, neurons - first)
        parts.append([("exc", first, size)])
    parts[-1].append(("inh", 0, net.inhibitory))
    if net.input_compartments:
        parts[-1].append(("inputs", 0, 40))
        parts.append([("inputs", 40, net.inputs - 40)])
    cores = []
    for number, held in enumerate(parts):
        chip, core = divmod(number * every, board.cores)
        exc = sum(size for name, _, size in held if name == "exc")
        starts = itertools.accumulate([0, *(size for _, _, size in held)])
        words = int(row_words(np.full(net.inputs, exc), 3).sum())
        placed = tuple(
            PopulationPart(name, first, size, start) for (name, first, size), start in zip(held, starts, strict=False)
        )
        total = sum(part.size for part in placed)
        taken = needs(board, total, net.inputs + neurons, 3 * total, words)
        load = Load(20.0, 300.0, 4.0, exc, 3.0, 2.0, 9000.0)
        time = None if board.constants is None else 1.0 + (10 * exc + number) / 1e3
        cores.append(CorePlan(chip, core, placed, np.arange(net.inputs) % 3 > 0, taken, load, time))
    hops = None if board.mesh is None else 12.5
    times = None if board.constants is None else TIMES
    return Plan(net, board, tuple(cores), 3, 8, hops, 0.0 if bias_input else 46.83, times)


PLANS = {
    "one core": lambda: plan(100),
    "six cores": lambda: plan(500, each=90),
    "bias": lambda: plan(150, bias_input=True),
    "many": lambda: plan(3000, each=40),
    "both chips, all cores": lambda: plan(2550, each=10),
    "leaves": lambda: plan(9000, each=50),
    "scattered": lambda: plan(300, every=50),
    "one neuron": lambda: plan(1),
    "loihi 2": lambda: plan(500, LOIHI_2),
    "loihi 2, bias": lambda: plan(9000, LOIHI_2, bias_input=True, each=4000),
}


def lines(table_of: Plan, **options: int) -> list[list[str]]:
    """The headings and cells of a table."""
    return list(csv.reader(io.StringIO(core_table(table_of, **options).csv())))


@pytest.mark.quick(3)
@pytest.mark.parametrize("name", PLANS)
def test_no_words_overlap_or_leave_the_page(name: str) -> None:
    figure = figure_of(PLANS[name]())
    renderer = FigureCanvasAgg(figure).get_renderer()
    height = figure.get_figheight() * 72
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in figure.axes[0].texts]
    for text, box in boxes:
        assert box.x0 >= 20, text
        assert box.x1 <= WIDTH - 20, text
        assert box.y0 >= 10, text
        assert box.y1 <= height - 10, text
    for (first, a), (second, b) in itertools.combinations(boxes, 2):
        apart = a.x1 <= b.x0 or b.x1 <= a.x0 or a.y1 <= b.y0 or b.y1 <= a.y0
        assert apart, (first, second)


def extent(path: ElementTree.Element) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of a drawn rectangle."""
    numbers = np.array(re.findall(r"-?[\d.]+", path.attrib["d"]), float).reshape(-1, 2)
    return (*numbers.min(axis=0), *numbers.max(axis=0))


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", ["six cores", "bias", "scattered", "loihi 2, bias"])
def test_each_core_shows_what_stands_on_it_in_proportion(name: str) -> None:
    shown = PLANS[name]()
    root = ElementTree.fromstring(draw(shown))
    drawn = {
        group.attrib["id"]: group for group in root.iter(f"{SVG}g") if re.match("exc|inh|inputs", group.get("id", ""))
    }
    wanted = {f"{part.population}-{core.chip}-{core.core}" for core in shown.cores for part in core.parts}
    assert set(drawn) == wanted
    corners = set()
    for core in shown.cores:
        total = sum(part.size for part in core.parts)
        boxes = {}
        for part in core.parts:
            (path,) = drawn[f"{part.population}-{core.chip}-{core.core}"].iter(f"{SVG}path")
            assert COLOURS[part.population] in path.attrib["style"]
            boxes[part.population] = extent(path)
        height = max(box[3] for box in boxes.values()) - min(box[1] for box in boxes.values())
        for part in core.parts:
            _, top, _, bottom = boxes[part.population]
            assert (bottom - top) / height == pytest.approx(part.size / total, abs=0.01)
        corners.add((min(box[0] for box in boxes.values()), min(box[1] for box in boxes.values())))
    assert len(corners) == len(shown.cores)


def test_tiles_run_down_the_columns_and_chips_stand_side_by_side() -> None:
    shown = plan(1024, each=4)
    root = ElementTree.fromstring(draw(shown))
    place = {
        tuple(int(word) for word in group.attrib["id"].split("-")[1:]): extent(next(group.iter(f"{SVG}path")))[:2]
        for group in root.iter(f"{SVG}g")
        if group.get("id", "").startswith("exc-")
    }
    assert len(place) == 256
    left, top = (np.array([[place[chip, core][axis] for core in range(128)] for chip in (0, 1)]) for axis in (0, 1))
    assert np.ptp(left[1] - left[0]) < 0.01
    assert (left[1] > left[0].max()).all()
    for tile in range(32):
        own = slice(4 * tile, 4 * tile + 4)
        assert np.ptp(left[0, own]) < 40
        assert np.ptp(top[0, own]) < 40
    # SANA-FE: tile t is at column t // 4, row t % 4.
    assert left[0, 16] > left[0, 0]
    assert top[0, 16] == top[0, 0]
    assert left[0, 4] == left[0, 0]
    assert top[0, 4] > top[0, 0]


def test_equal_plans_give_equal_bytes_whatever_the_users_style(monkeypatch: pytest.MonkeyPatch) -> None:
    first = draw(plan(100))
    plan.cache_clear()
    with matplotlib.rc_context({"font.size": 30, "svg.fonttype": "none", "svg.hashsalt": "x", "lines.linewidth": 9}):
        assert draw(plan(100)) == first
        assert matplotlib.rcParams["font.size"] == 30
    assert draw(plan(101)) != first
    text = first.decode()
    assert text.startswith("<?xml")
    assert 'width="1200"' in text
    assert "<text" not in text  # paths: no font is needed
    for word in ("dc:date", "matplotlib.org", "20[0-9]{2}-"):
        assert not re.search(word, text), word


def test_many_cores_are_drawn_small_and_the_busiest_large() -> None:
    def words(shown: Plan) -> list[str]:
        return [text.get_text() for text in figure_of(shown).axes[0].texts]

    few, many = words(plan(100 * MOST_CARDS)), words(plan(100 * MOST_CARDS + 1))
    assert "cores in use" in few
    assert sum(word.startswith("chip 0, core ") for word in few) == MOST_CARDS
    assert f"the 4 busiest of {MOST_CARDS + 1} cores in use" in many
    cards = [word for word in many if word.startswith("chip 0, core ")]
    assert cards == [f"chip 0, core {core}" for core in range(MOST_CARDS - 4, MOST_CARDS)]
    other = words(plan(500, LOIHI_2))
    assert "the chip: 5 of 128 cores; Intel's compiler decides which" in other
    assert other.count("other limits are not public") == 5


# --- table and words -------------------------------------------------------------------------------------------------


def test_a_row_says_what_a_core_holds_and_takes() -> None:
    shown = plan(150, bias_input=True)
    table = lines(shown)
    rows = {row[0]: row for row in table if len(row) == 9}
    words = row_words(np.full(120, 50), 3).sum()
    used = network(150, bias_input=True).weights[:, 100:].any(axis=1)
    dense = int((used & (np.arange(120) % 3 > 0)).sum())
    assert rows["0:1"] == [
        "0:1",
        "exc 100..149\ninh 0\ninputs 0..39",
        "91 of 1,024",
        "270 of 4,096",
        "273 of 4,096",
        f"{100 * words / 16384:.1f} %",
        f"{dense}",
        f"{int(used.sum()) - dense}",
        "1.50 µs",
    ]
    assert rows["0:2"][1] == "inputs 40..119"
    assert rows["all"][1:3] == ["3 of 256 cores", "271"]
    assert rows["all"][8] == "11.7 µs"
    assert sum(rows_of(shown, core)[0] or 0 for core in shown.cores) == int(rows["all"][6])


def test_limits_that_are_not_public_are_called_unknown() -> None:
    rows = {row[0]: row for row in lines(plan(500, LOIHI_2)) if len(row) == 9}
    assert rows["0"][2:8] == ["100 of 8,192", *["unknown"] * 5]
    assert rows["all"][3:8] == ["unknown"] * 5
    assert share(None, 3) == share(3, None) == "unknown"


def test_long_tables_leave_out_the_middle() -> None:
    rows = [row for row in lines(plan(3000, each=25), most=6) if len(row) == 9]
    names = [row[0] for row in rows]
    assert names == ["core", "0:0", "0:1", "0:2", "...", "0:118", "0:119", "0:120", "all"]
    assert rows[4][1] == "115 more cores"
    assert len([row for row in lines(plan(600), most=6) if len(row) == 9]) == 8


def test_only_of_a_small_plan_fit_tells_in_short() -> None:
    cores, relays, leaves = plan(1000, each=20), plan(1500), plan(5000, bias_input=True, each=500)
    for one, short in ((plan(500), True), (plan(500, LOIHI_2), True), (cores, False), (relays, False), (leaves, False)):
        told = placed(one, (), (), short=True)
        assert told[0] == placed(one, (), ())[0]
        assert told[2:] == ([in_short(one, 0)] if short else ["\n".join(summary(one)[1:]), rests_on(())])


def test_the_summary_says_what_limits_and_what_clears() -> None:
    text = " ".join(summary(plan(500)))
    assert text.startswith(
        "5 of 256 cores, 3 bits a stored weight. "
        "One inhibitory neuron inhibits every neuron 2 steps after any has spiked. "
        "Modelled on 100 of its 500 reference images, asked as queries: 0.153 ms (0.0700 to 1,230) a query of 64 "
        "steps, 11.7 µs (5.00 to 34.1) a step, 2.00 µs of it on the busiest core (0:4). `lava-vpr bench` models "
        "other queries. The embedded processors' tables take up to 7.1 KiB (6.0 KiB with --ways masks); how much "
        "memory they have is not public. Messages cross 12.5 tiles a step. "
    )
    assert "The host sends up to 46.8 spikes a step to each chip (limit: 56)." in text
    assert "an embedded processor of each chip writes v = 0" in text
    assert busiest(plan(500)).core == 4
    large = " ".join(summary(plan(5000, each=50)))
    assert "One inhibitory neuron, the root of 2 others, inhibits every neuron 3 steps after any" in large
    assert "spikes a step to each chip (limit: 56), where relays pass them on." in large
    assert "The host sends no spikes: inputs integrate a bias" in " ".join(summary(plan(150, bias_input=True)))
    other = " ".join(summary(plan(500, LOIHI_2)))
    assert "Which cores they are, and how synapses are stored, is decided by Intel's compiler." in other
    assert "Time of a step: unknown; nobody has published how long operations of Loihi 2 take." in other
    assert "(limit: unknown)" in other
    assert "tiles" not in other
    assert "LIFReset" in other
