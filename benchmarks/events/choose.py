"""Chooses how images of events are learned, on places 0:50 of LENS's example alone.

python -m benchmarks.events.choose > benchmarks/events/choose.log

Each line is one candidate, with the mean R@1 and R@100P over seeds 0, 1 and 2 of its best decoder, by their sum; of
equal sums the first is taken, which is the one with fewer views.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from benchmarks.events.lens import counts, drive, measured, truth
from benchmarks.nordland import required
from lava_vpr.config import Config, preset
from lava_vpr.traverse import Traverse

PLACES = slice(0, 50)


def candidates() -> Iterator[tuple[str, Config, int, float]]:
    """Name, settings, and cells and blur of counts (0 cells: the images themselves)."""
    base = preset("loihi")
    kinds = [("orientation", replace(base.encoder, kind="orientation")), ("onoff", replace(base.encoder, kind="onoff"))]
    for share in (0.8, 0.9, 0.95):
        kinds.append((f"events, saturation {share:g}", replace(base.encoder, kind="events", saturation=share)))
    for shifts in (1, 3):
        for name, encoder in kinds:
            config = replace(base, encoder=encoder, views=replace(base.views, shifts=shifts))
            yield f"{name}, {shifts} view{'s' * (shifts > 1)}", config, 0, 0.0
    for cells in (10, 14, 20):
        for blur in (0.0, 2.0):
            for zone in (0.0, 0.5):
                encoder = replace(base.encoder, vector_dead_zone=zone)
                name = f"{cells} x {cells} counts less their mean, blur {blur:g}, dead zone {zone:g}"
                yield name, replace(base, encoder=encoder), cells, blur


def main() -> None:
    """Print a line of each candidate, and the one that is chosen."""
    required("lens_example")
    pair, right = [drive(which, PLACES) for which in ("reference", "query")], truth(PLACES)
    best: tuple[float, str] = (0.0, "none")
    for name, config, cells, blur in candidates():
        shown: list[Traverse] = [counts(one, cells, blur) for one in pair] if cells else pair
        found = measured(config, *shown, right, ())
        decoder = max(found, key=lambda one: round(found[one].r1 + found[one].full, 6))
        figures = found[decoder]
        print(f"{name:58} {decoder:21} R@1 {figures.r1:.3f}  R@100P {figures.full:.3f}", flush=True)
        if round(figures.r1 + figures.full, 6) > best[0]:
            best = round(figures.r1 + figures.full, 6), f"{name}; decoder {decoder}"
    print(f"chosen: {best[1]}")


if __name__ == "__main__":
    main()
