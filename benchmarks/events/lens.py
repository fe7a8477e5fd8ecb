"""The example of LENS: 100 places as frames of an event camera, two drives, with its ground truth."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.nordland import images_of, required
from lava_vpr.config import Config, for_events, preset
from lava_vpr.encoding import Keep, encode_traverse, encode_views
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.training.loop import train
from lava_vpr.training.standard import fitted, settings_for
from lava_vpr.traverse import Traverse, open_traverse, vector_traverse
from lava_vpr.vectors.source import Vectors

TOLERANCE = 3
SEEDS = (0, 1, 2)


class Figures(NamedTuple):
    """Mean figures of a matcher over seeds, fractions: R@1, R@5, R@10, R@100P; and the least R@1 of them."""

    r1: float
    r5: float
    r10: float
    full: float
    least: float

    def shown(self) -> str:
        """The figures in columns."""
        return f"{self.r1:6.3f} {self.r5:6.3f} {self.r10:6.3f} {self.full:8.3f} {self.least:10.2f}"


def folder() -> Path:
    """The folder with the example; errors as `images_of`."""
    return images_of("lens_example", "reference").parent


def drive(which: str, places: slice) -> Traverse:
    """Frames of the ``reference`` or the ``query`` drive."""
    return open_traverse(folder() / which, places=(places.start, places.stop))


def truth(places: slice) -> NDArray[np.bool_]:
    """Which places are right for which query, bool (queries, places): those of LENS's own truth, 3 places around."""
    own = np.load(folder() / "ground_truth.npy").astype(np.uint8)
    near = cv2.dilate(own, np.ones((1, 2 * TOLERANCE + 1), np.uint8))  # along the places
    return np.asarray(near[places, places] > 0)


def counts(traverse: Traverse, cells: int, blur: float = 0.0) -> Traverse:
    """The frames as vectors: how many events each of ``cells`` x ``cells`` parts of the image has, after a blur."""
    rows = []
    for image in traverse.images():
        values = image.astype(np.float32)
        if blur:
            values = cv2.GaussianBlur(values, (0, 0), blur)
        rows.append(cv2.resize(values, (cells, cells), interpolation=cv2.INTER_AREA).ravel())
    return vector_traverse("counts", Vectors(np.stack(rows)))


def measured(
    config: Config, references: Traverse, queries: Traverse, right: NDArray[np.bool_], rivals: Sequence[str] | None
) -> dict[str, Figures]:
    """Figures of every decoder, and of ``rivals`` (None: all), over `SEEDS`."""
    config = settings_for(config, [references])
    standard = fitted(config, [references])
    learned = list(encode_views(references, config.encoder, config.views.views, Keep.ALL, standard=standard))
    asked = encode_traverse(queries, config.encoder, Keep.ALL, standard=standard)
    found: dict[str, list[Metrics]] = defaultdict(list)
    for seed in SEEDS:
        model = train(learned, replace(config, seed=seed), standard=standard)
        for name, metrics in recognise(
            model, asked, right, Comparison(rivals=rivals, keep_scores=False)
        ).metrics.items():
            found[name].append(metrics)
    return {
        name: Figures(
            float(np.mean([one.recall_at_1 for one in each])),
            float(np.mean([one.recall_at_n[5] for one in each])),
            float(np.mean([one.recall_at_n[10] for one in each])),
            float(np.mean([one.recall_at_100_precision for one in each])),
            min(one.recall_at_1 for one in each),
        )
        for name, each in found.items()
    }


def main() -> None:
    """Print the figures of docs/events.md, on places that the search did not see (50:100), and on all."""
    required("lens_example")
    events = for_events(preset("loihi"))
    plain = preset("loihi")
    print("lens_example, tolerance 3, seeds 0, 1, 2: means, and the least R@1")
    print("LENS itself, on all places (its own figures)            R@1 .63, R@5 .84, R@10 .95")
    for places in (slice(50, 100), slice(0, 100)):
        pair, right = [drive(which, places) for which in ("reference", "query")], truth(places)
        print(f"\nplaces {places.start}:{places.stop}{'':28}R@1    R@5   R@10   R@100P  least R@1")
        found = measured(events, *pair, right, None)
        _show({"events, standard (the default)": found["standard"], "events, contrast": found["contrast"]})
        _show({f"events, {name}": found[name] for name in ("cosine", "template")})
        _show({f"{name}, three views": found[name] for name in ("sad", "hog")})
        found = measured(plain, *pair, right, None)
        _show({f"orientation, {name}": found[name] for name in ("standard", "contrast", "cosine")})
        _show({name: found[name] for name in ("sad", "hog")})
        cells = [counts(one, 14, 2.0) for one in pair]
        found = measured(replace(plain, encoder=replace(plain.encoder, vector_dead_zone=0.0)), *cells, right, None)
        wanted = {"vectors": "as they are", "standardised": "mean off", "standard": "standard"}
        _show({f"14 x 14 counts, {told}": found[name] for name, told in wanted.items() if name in found})


def _show(rows: dict[str, Figures]) -> None:
    for name, figures in rows.items():
        print(f"  {name:34} {figures.shown()}")


if __name__ == "__main__":
    main()
