"""Where the five benchmark datasets keep their images, and which of their traverses the paper uses.

Source: Hussaini et al. 2022 (doi 10.1109/LRA.2022.3149030), section on datasets, for the choice of traverses and the
sampling; the folders are those of the datasets as distributed, or of the usual curated copies.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from lava_vpr.errors import InputError
from lava_vpr.images.imageio import shown
from lava_vpr.traverse import Traverse, open_traverse


@dataclass(frozen=True)
class Layout:
    """One way in which a dataset lies on disk.

    Attributes:
        name: Name of the dataset.
        references: Folder (or video) of each reference traverse, below the dataset's root.
        query: Folder (or video) of the query traverse.
        step: Every which image is used: 8 takes images 0, 8, 16 ...
        ground_truth: ``frames``: image k of every traverse shows the same place, and all are equally long;
            ``positions``: they were taken at different speeds, so a position or ground truth file must say.
        every: Of videos, seconds between two frames.
    """

    name: str
    references: tuple[str, ...]
    query: str
    step: int = 1
    ground_truth: Literal["frames", "positions"] = "frames"
    every: float = 1.0


_STEREO = "RGB/Stereo_Left/Omni_F"
_SUN, _RAIN, _DUSK = "2015-08-12-15-04-18", "2015-10-29-12-18-17", "2014-11-21-16-07-03"
_MORNING, _AFTERNOON = ("190809{}0845", "180809{}1545")


def _oxford(inner: str) -> Layout:
    # As distributed these are Bayer mosaics, which load as grey images; the dataset's own kit turns them into colour.
    return Layout("oxford", (_SUN + inner, _RAIN + inner), _DUSK + inner, ground_truth="positions")


def _synthia(prefix: str) -> Layout:
    fog, night = f"{prefix}SEQS-04-FOG/{_STEREO}", f"{prefix}SEQS-04-NIGHT/{_STEREO}"
    return Layout("synthia", (fog,), night, step=5, ground_truth="positions")


def _st_lucia(dash: str, inner: str) -> Layout:
    return Layout(
        "st_lucia", (_MORNING.format(dash) + inner,), _AFTERNOON.format(dash) + inner, ground_truth="positions"
    )


#: Layouts of each dataset, in the order in which they are tried.
LAYOUTS: dict[str, tuple[Layout, ...]] = {
    # One image a second; the paper takes every eighth. Images where the train is slow must have been removed.
    "nordland": (Layout("nordland", ("spring", "fall"), "summer", step=8),),
    "oxford": (
        _oxford("/stereo/left"),
        _oxford("/stereo/centre"),
        _oxford(""),
        Layout("oxford", ("sun", "rain"), "dusk"),
    ),
    "spedtest": (Layout("spedtest", ("ref",), "query"),),
    # Five images a second, the paper takes one a second.
    "synthia": (_synthia("SYNTHIA-"), _synthia(""), Layout("synthia", ("ref",), "query")),
    "st_lucia": (
        *(_st_lucia(dash, inner) for inner in ("/webcam_video.avi", "/frames", "") for dash in "_-"),
        Layout("st_lucia", ("ref",), "query"),
    ),
}


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
    if name not in LAYOUTS:
        raise InputError(f"there is no dataset {name!r}; choose from {', '.join(LAYOUTS)}")
    root = Path(root)
    if not root.is_dir():
        raise InputError(f"{shown(root)}: is not a folder; give the folder that holds the {name} dataset")
    missing = []
    for layout in LAYOUTS[name]:
        wanted = (*layout.references, layout.query)
        found = [_below(root, relative) for relative in wanted]
        paths = tuple(path for path in found if path is not None)
        if len(paths) == len(wanted):
            return layout, paths[:-1], paths[-1]
        missing.append(" + ".join(f"{w} (missing)" if f is None else w for w, f in zip(wanted, found, strict=True)))
    raise InputError(f"{shown(root)}: does not hold the {name} dataset; it needs the folders {', or '.join(missing)}")


def open_dataset(name: str, root: str | Path, *, step: int | None = None) -> tuple[list[Traverse], Traverse]:
    """The paper's reference traverses and query traverse of dataset ``name`` (a key of `LAYOUTS`) below ``root``.

    Args:
        name: nordland, oxford, spedtest, synthia or st_lucia.
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


__all__ = ["LAYOUTS", "Layout", "find_layout", "open_dataset"]
