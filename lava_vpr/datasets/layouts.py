"""Where the five benchmark datasets keep their images, and which of their traverses the paper uses.

Source: Hussaini et al. 2022 (doi 10.1109/LRA.2022.3149030), section on datasets, for the choice of traverses and the
sampling; the folders are those of the datasets as distributed, or of the usual curated copies.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from lava_vpr.errors import InputError
from lava_vpr.rows.registry import Registry
from lava_vpr.storage.text import shown
from lava_vpr.traverse import Traverse, open_traverse


@dataclass(frozen=True)
class Layout:
    """One way in which a dataset lies on disk.

    Attributes:
        references: Folder (or video) of each reference traverse, below the dataset's root.
        query: Folder (or video) of the query traverse.
        step: Distance from one image in use to the next: 8 takes images 0, 8, 16 ...
        ground_truth: ``frames``: image k of every traverse shows the same place, and all are equally long;
            ``positions``: they were taken at different speeds, so a position or ground truth file must say.
        every: Seconds between two frames of a video.
    """

    references: tuple[str, ...]
    query: str
    step: int = 1
    ground_truth: Literal["frames", "positions"] = "frames"
    every: float = 1.0


@dataclass(frozen=True)
class Dataset:
    """A benchmark dataset and the ways in which it may lie on disk.

    Attributes:
        name: How it is called.
        layouts: The ways in which it may lie on disk, in the order in which they are tried.
    """

    name: str
    layouts: tuple[Layout, ...]


DATASETS: Registry[Dataset] = Registry("dataset", InputError)
"""The benchmark datasets, by name."""

_STEREO = "RGB/Stereo_Left/Omni_F"
_SUN, _RAIN, _DUSK = "2015-08-12-15-04-18", "2015-10-29-12-18-17", "2014-11-21-16-07-03"
_MORNING, _AFTERNOON = ("190809{}0845", "180809{}1545")


def _oxford(inner: str) -> Layout:
    # As distributed these are Bayer mosaics, which load as grey images; the dataset's own kit turns them into colour.
    return Layout((_SUN + inner, _RAIN + inner), _DUSK + inner, ground_truth="positions")


def _synthia(prefix: str) -> Layout:
    fog, night = f"{prefix}SEQS-04-FOG/{_STEREO}", f"{prefix}SEQS-04-NIGHT/{_STEREO}"
    return Layout((fog,), night, step=5, ground_truth="positions")


def _st_lucia(dash: str, inner: str) -> Layout:
    return Layout((_MORNING.format(dash) + inner,), _AFTERNOON.format(dash) + inner, ground_truth="positions")


# One image a second; the paper takes every eighth. Images where the train is slow must have been removed.
DATASETS.register(Dataset("nordland", (Layout(("spring", "fall"), "summer", step=8),)))
DATASETS.register(
    Dataset(
        "oxford",
        (_oxford("/stereo/left"), _oxford("/stereo/centre"), _oxford(""), Layout(("sun", "rain"), "dusk")),
    )
)
DATASETS.register(Dataset("spedtest", (Layout(("ref",), "query"),)))
# Five images a second, the paper takes one a second.
DATASETS.register(Dataset("synthia", (_synthia("SYNTHIA-"), _synthia(""), Layout(("ref",), "query"))))
DATASETS.register(
    Dataset(
        "st_lucia",
        (
            *(_st_lucia(dash, inner) for inner in ("/webcam_video.avi", "/frames", "") for dash in "_-"),
            Layout(("ref",), "query"),
        ),
    )
)


def _below(root: Path, relative: str) -> Path | None:
    """``relative`` below ``root`` in any letter case, or None."""
    path = root
    for part in relative.split("/"):
        if (path / part).exists():
            path = path / part
            continue
        try:
            same = sorted(entry for entry in path.iterdir() if entry.name.lower() == part.lower())
        except OSError:
            return None
        if not same:
            return None
        path = same[0]
    return path


def find_layout(name: str, root: str | Path) -> tuple[Layout, tuple[Path, ...], Path]:
    """How dataset ``name`` lies below ``root``: the layout, its references' paths and its query's path.

    Raises:
        InputError: no such dataset is known, or none of its layouts is there; lists the folders looked for.
    """
    layouts = DATASETS[name].layouts
    root = Path(root)
    if not root.is_dir():
        raise InputError(f"{shown(root)}: is not a folder; give the folder that holds the {name} dataset")
    missing = []
    for layout in layouts:
        folders = (*layout.references, layout.query)
        paths = [_below(root, folder) for folder in folders]
        present = tuple(path for path in paths if path is not None)
        if len(present) == len(folders):
            return layout, present[:-1], present[-1]
        parts = (f if path is not None else f"{f} (missing)" for f, path in zip(folders, paths, strict=True))
        missing.append(" + ".join(parts))
    raise InputError(f"{shown(root)}: does not hold the {name} dataset; it needs the folders {', or '.join(missing)}")


def open_dataset(name: str, root: str | Path, *, step: int | None = None) -> tuple[list[Traverse], Traverse]:
    """The paper's reference traverses and query traverse of dataset ``name`` (in `DATASETS`) below ``root``.

    Args:
        name: Name of a row in `DATASETS`.
        root: The folder that holds the dataset.
        step: Use every ``step``-th image instead of the layout's number; 1 if the images were sampled already.
    Returns:
        References, query. Images keep their absolute indices in the full folders.
    Raises:
        InputError: no such dataset, folders missing or empty, or traverses unequally long though images correspond.
    """
    if step is not None and step < 1:
        raise InputError(f"step is {step}, but must be at least 1")
    layout, references, query = find_layout(name, root)
    sources = (*references, query)
    whole = [open_traverse(source, every=layout.every) for source in sources]
    if layout.ground_truth == "frames" and len({len(traverse) for traverse in whole}) > 1:
        lengths = ", ".join(f"{shown(source)} has {len(t)}" for source, t in zip(sources, whole, strict=True))
        raise InputError(f"image k must show the same place in every traverse of {name}, but {lengths}; complete them")
    sampled = [traverse.take(range(0, len(traverse), step or layout.step)) for traverse in whole]
    return sampled[:-1], sampled[-1]
