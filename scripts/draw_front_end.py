"""Draws docs/front_end.png: one image in the layers of the spiking front end, as its populations spike.

python scripts/draw_front_end.py [FILE]
"""

from __future__ import annotations

import io

from drawn_world import WORLD, target
from PIL import Image

from lava_vpr.inputs.front_end import FRONT_END
from lava_vpr.report.layers import Layers, picture
from lava_vpr.synthetic.world import render

PLACE = 32


def main() -> None:
    file = target("front_end.png", "Draw the second picture of docs/concepts.md.")
    found = Layers.of(FRONT_END, render(WORLD, PLACE, "winter"), file.name)
    drawn = Image.open(io.BytesIO(picture(found))).convert("RGB")
    drawn.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    print(f"{file.name}: {FRONT_END.steps} steps; {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
