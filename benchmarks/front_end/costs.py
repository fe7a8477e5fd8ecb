"""What the spiking front end costs a query, layer by layer, by the constants of Kapoho Bay; nothing was measured.

    LAVA_VPR_DATA=... python -m benchmarks front_end.costs [--record]

Spikes of winter images of Nordland are counted as `lava-vpr bench` counts those of queries
(`lava_vpr.deploy.cost.front_end`), for the front ends of two presets.
"""

from __future__ import annotations

import numpy as np

from benchmarks.places import FOLDERS, images_of
from benchmarks.program import BenchmarkTable, Printed, program
from lava_vpr.bench.show.front_end import HEADS, cells
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.cost.front_end import front_end_costs
from lava_vpr.deploy.mapping.front_end import placed
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.inputs.front_end_settings import FRONT_END, front_end
from lava_vpr.traverse import open_traverse

IMAGES = slice(0, 500, 25)
OTHERS = {"all, 52 steps (32 levels, a race of 15)": (32, 15), "all, 29 steps (`--preset fast`)": (16, 8)}
"""Levels and race of the forms whose totals alone are printed."""


@program("nordland")
def main() -> Printed:
    """Neurons, synapses, spikes, operations, accesses, updates, messages and energy of each layer; other totals."""
    winter = list(open_traverse(images_of("nordland", FOLDERS["nordland"][1])).images())[IMAGES]
    grey = np.stack([FRONT_END.seen(image) for image in winter])
    whole = front_end_costs(FRONT_END, placed(FRONT_END, KAPOHO_BAY), PixelBlock(grey))
    rows = [(name.replace("all", f"all, {whole.steps} steps"), *figures) for name, *figures in cells(whole)]
    for title, sizes in OTHERS.items():
        spec = front_end(*sizes)
        _, *totals = cells(front_end_costs(spec, placed(spec, KAPOHO_BAY), PixelBlock(grey)))[-1]
        rows.append((title, *totals))
    yield BenchmarkTable(["population", *HEADS], rows, record="front-end-costs")
