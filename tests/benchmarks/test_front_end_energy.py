"""What the benchmark of whole energies adds for the spiking front end, and what the page says of it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.figures import read
from benchmarks.front_end.energy import with_front_end
from lava_vpr.bench.results import AnsweringWay
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.constants import Estimate, total
from lava_vpr.deploy.cost.front_end import front_end_costs
from lava_vpr.deploy.mapping.front_end import placed
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.errors import InputError
from lava_vpr.inputs.front_end import FrontEnd


def test_the_front_end_adds_its_steps_registers_and_static_energy() -> None:
    spec = FrontEnd(16)
    grey = np.random.default_rng(0).integers(0, 256, (2, spec.height, spec.width)).astype(np.uint8)
    costs = front_end_costs(spec, placed(spec, KAPOHO_BAY), PixelBlock(grey))
    assert costs.dynamic_microjoules is not None
    assert costs.between_microjoules is not None
    assert costs.static_millijoules is not None
    one = Estimate(1, 2, 4)
    way = AnsweringWay("kapoho-bay", 1.0, 0.1, 0.2, one, one, one)
    made = with_front_end(way, spec, grey)
    added = total([*costs.dynamic_microjoules.values(), *costs.between_microjoules.values()])
    for level in ("low", "nominal", "high"):
        assert made.dynamic is not None
        assert made.static is not None
        assert made.dynamic.at(level) == pytest.approx(one.at(level) + added.at(level))
        assert made.static.at(level) == pytest.approx(one.at(level) + 1e3 * costs.static_millijoules.at(level))
    assert (made.io_static, made.work, made.encoding) == (way.io_static, way.work, way.encoding)
    with pytest.raises(InputError, match="has no energies"):
        with_front_end(None, spec, grey)


def test_a_front_end_on_the_board_is_not_below_the_best_way_on_a_processor() -> None:
    kept = read("front-end-energy")
    whole = {row[0]: float(row[kept.columns.index("a whole query")].split()[0].replace(",", "")) for row in kept.rows}
    boards = [name for name in whole if name.endswith(", Kapoho Bay")]
    frames, direct, events = boards
    assert [name.split(",")[0] for name in boards] == ["`frontend`", "`frontend-direct`", "`frontend-events`"]
    for name in (frames, events):
        assert whole[name] > whole[name.replace("Kapoho Bay", "`cosine` of `orientation`")]
    assert whole[frames] > whole[direct] > whole[frames.replace("Kapoho Bay", "`cosine` of `orientation`")]
