"""Draws docs/season.jpg: what a map learned in summer has learned to trust by the end of a drive in winter.

python scripts/draw_season.py [FILE]

The synthetic world draws both journeys; `lava_vpr.Localizer` drives the winter once, with ``learn=True``.
"""

from __future__ import annotations

from drawn_world import WORLD, show, summer, target
from matplotlib import pyplot

from lava_vpr import Localizer, train
from lava_vpr.report.season import trusted
from lava_vpr.synthetic.world import render


def main() -> None:
    file = target("season.jpg", "Draw the picture of a season that was learned.")
    references, middle = summer(), WORLD.places // 2
    robot = Localizer(train(references), learn=True)
    for place in range(WORLD.places):
        robot.update(render(WORLD, place, "winter"))
    season = robot.season
    if season is None:
        raise TypeError("a robot that learns knows a season")
    figure, axes = pyplot.subplots(1, 3, figsize=(11, 2.3), layout="constrained")
    titles = (
        f"place {middle}, learned in summer",
        "the same place in winter",
        f"trusted after {WORLD.places} images of winter",
    )
    images = (references[middle], render(WORLD, middle, "winter"), trusted(robot.model, season.gains))
    for axis, title, image in zip(axes, titles, images, strict=True):
        show(axis, image, aspect="auto")
        axis.set_title(title, fontsize=10)
    figure.savefig(file, dpi=90, pil_kwargs={"quality": 80})
    print(f"{file.name}: {season.taught} of {season.answered} answers taught; {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
