"""Where the five benchmark datasets keep their images, and what of them the paper uses.

Source: Hussaini et al. 2022 (doi 10.1109/LRA.2022.3149030), section IV.B, for traverses, sampling and sections; what it
does not say is a field of its own. The folders are those of the datasets as distributed, or of the usual curated
copies: VPR-Bench's ``ref`` and ``query``, or one folder for each condition. The lists are the authors' own: VPRSNN's
repository (github.com/QVPR/VPRSNN, commit d38f30c), ``dataset_imagenames``, of which they take every eighth line
(``tools/data_utils.py``, option ``--skip``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from lava_vpr.errors import InputError, shown
from lava_vpr.rows.registry import Registry
from lava_vpr.traverse import Traverse


@dataclass(frozen=True)
class DatasetLayout:
    """One way in which a dataset lies on disk.

    Attributes:
        references: Folder (or video, or list of images) of each reference traverse, below the dataset's root.
        query: Folder (or video, or list) of the query traverse.
        step: Distance from one image in use to the next: 8 takes images 0, 8, 16 ...
        ground_truth: ``frames``: image k of every traverse shows the same place, and all are equally long;
            ``positions``: they were taken at different speeds, so a position or ground truth file must say.
        every: Seconds between two frames of a video.
        spacing: Metres between two places, which positions must tell; None: every sampled image is a place.
        kept: Images of a traverse that the authors' list keeps; in folders with more, every step-th is another place.
    """

    references: tuple[str, ...]
    query: str
    step: int = 1
    ground_truth: Literal["frames", "positions"] = "frames"
    every: float = 1.0
    spacing: float | None = None
    kept: int | None = None

    @property
    def folders(self) -> tuple[str, ...]:
        """The folders of all traverses, references first."""
        return (*self.references, self.query)

    @property
    def needs_positions(self) -> bool:
        """Whether nothing but positions tells which images of its references are the places."""
        return self.spacing is not None or (self.ground_truth == "positions" and len(self.references) > 1)


@dataclass(frozen=True)
class Dataset:
    """A benchmark dataset, the ways in which it may lie on disk, and what the paper does with it.

    Attributes:
        name: By what name users choose it.
        title: How the paper calls it.
        layouts: The ways in which it may lie on disk, in the order in which they are tried.
        what: What it shows, a sentence.
        page: The page that distributes it.
        download: What to download there, and what to do with it.
        learned: The paper's reference traverses, in words.
        recognised: Its query traverse, in words.
        sampling: How the paper chooses places, and how the layouts do.
        truth: What says which place a query shows.
        unsaid: What the paper does not say.
        sections: Sections of the route that the paper learns, one model each.
        places: Places of a section.
        route: Whether places follow each other; else no image tells of the next.
    """

    name: str
    title: str
    layouts: tuple[DatasetLayout, ...]
    what: str
    page: str
    download: str
    learned: tuple[str, ...]
    recognised: str
    sampling: str
    truth: str
    unsaid: str
    sections: int
    places: int = 100
    route: bool = True

    def section(self, number: int) -> tuple[int, int]:
        """Places A, B of a section, A..B-1, counted among the sampled places.

        Args:
            number: From 1.
        Raises:
            InputError: the paper has no such section.
        """
        if not 1 <= number <= self.sections:
            have = f"sections 1 to {self.sections}" if self.sections > 1 else "section 1 alone"
            raise InputError(f"section {number} of {self.title} is none of the paper's; it has {have}")
        return (number - 1) * self.places, number * self.places

    @property
    def task(self) -> str:
        """What the paper learns and recognises, in words."""
        return f"{' and '.join(self.learned)} learned, {self.recognised} recognised"


DATASETS: Registry[Dataset] = Registry("dataset", InputError)
"""The benchmark datasets, by name."""

_STEREO = "RGB/Stereo_Left/Omni_F"
_SUN, _RAIN, _DUSK = "2015-08-12-15-04-18", "2015-10-29-12-18-17", "2014-11-21-16-07-03"
_MORNING, _AFTERNOON = ("190809{}0845", "180809{}1545")


def _listed(dataset: str, *traverses: str) -> DatasetLayout:
    """The authors' lists of a dataset's traverses, the query last: line k of each shows the same place."""
    *references, query = (f"{dataset}_imageNames_{traverse}.txt" for traverse in traverses)
    return DatasetLayout(tuple(references), query, step=8)


def _oxford(inner: str) -> DatasetLayout:
    # As distributed these are Bayer mosaics, which load as grey images; the dataset's own kit turns them into colour.
    return DatasetLayout((_SUN + inner, _RAIN + inner), _DUSK + inner, ground_truth="positions", spacing=10.0)


def _synthia(prefix: str) -> DatasetLayout:
    fog, night = f"{prefix}SEQS-04-FOG/{_STEREO}", f"{prefix}SEQS-04-NIGHT/{_STEREO}"
    return DatasetLayout((fog,), night, step=5, ground_truth="positions")


def _st_lucia(dash: str, inner: str) -> DatasetLayout:
    morning, afternoon = _MORNING.format(dash) + inner, _AFTERNOON.format(dash) + inner
    return DatasetLayout((morning,), afternoon, ground_truth="positions", spacing=20.0)


DATASETS.register(
    Dataset(
        "nordland",
        "Nordland",
        (
            _listed("nordland", "spring", "fall", "summer"),
            DatasetLayout(("spring", "fall"), "summer", step=8, kept=27_592),
        ),
        what="A railway of 728 km in Norway, filmed from the train in four seasons "
        "(https://nrkbeta.no/2013/01/15/nordlandsbanen-minute-by-minute-season-by-season/).",
        page="https://huggingface.co/datasets/Somayeh-h/Nordland",
        download="Spring, fall and summer, an image a second, image k of each season at the same place, as "
        "FOLDER/nordland/spring and so on; and, into FOLDER, the authors' lists of what they keep, without tunnels, "
        "stops and where the train is slower than 15 km/h: https://github.com/QVPR/VPRSNN, "
        "dataset_imagenames/nordland_imageNames_spring.txt, _fall.txt and _summer.txt. Or leave those images out, and "
        "name the folders FOLDER/spring and so on.",
        learned=("spring", "fall"),
        recognised="summer",
        sampling="Every eighth image, 8 s or about 100 m apart.",
        truth="Image k shows the same place in every season.",
        unsaid="Where in the first quarter of the journey each section begins: here they follow each other from the "
        "first image on, as the authors' code counts them. 15 sections are 12,000 s, more than a quarter of 27,592 "
        "images a season.",
        sections=15,
    )
)
DATASETS.register(
    Dataset(
        "oxford",
        "Oxford RobotCar",
        (
            _listed("ORC", "Sun", "Rain", "Dusk"),
            *map(_oxford, ("/stereo/left", "/stereo/centre", "")),
            DatasetLayout(("sun", "rain"), "dusk", ground_truth="positions"),
        ),
        what="A car's route through Oxford, driven twice a week for more than a year.",
        page="https://robotcar-dataset.robots.ox.ac.uk/",
        download=f"The stereo images and GPS/INS of {_SUN} (sun), {_RAIN} (rain) and {_DUSK} (dusk). Or those 3,876 of "
        "each that the authors list, at the same places: https://github.com/QVPR/VPRSNN, dataset_imagenames: "
        "ORC_Sun_timestamps.csv and so on say which image is FOLDER/ORC/Sun/000000.png; ORC_imageNames_Sun.txt, "
        "_Rain.txt and _Dusk.txt go into FOLDER.",
        learned=("sun", "rain"),
        recognised="dusk",
        sampling="A place about every 10 m; of the authors' lists every eighth line; of folders sun, rain and dusk, "
        "which somebody has sampled, every image.",
        truth="Positions (--positions, a file for each traverse), since the car drove at different speeds; of the "
        "authors' lists, line k shows the same place in each.",
        unsaid="Which camera, where the sections begin, and how near the query of a place must be: here they follow "
        "each other from the first image on, and the query is the nearest image, or the same line of the lists.",
        sections=4,
    )
)
DATASETS.register(
    Dataset(
        "spedtest",
        "SPEDTest",
        (DatasetLayout(("ref",), "query"),),
        what="Surveillance cameras around the world, each seen at two times; no route.",
        page="https://github.com/MubarizZaffar/VPR-Bench",
        download="The folder SPEDTEST of VPR-Bench's datasets, with ref and query in it.",
        learned=("ref",),
        recognised="query",
        sampling="Every image.",
        truth="Image k of both folders is from the same camera.",
        unsaid="Which images the sections hold, and which of the two times is learned: here they follow each other "
        "from the first image on, and ref is learned.",
        sections=6,
        route=False,
    )
)
DATASETS.register(
    Dataset(
        "synthia",
        "Synthia",
        (_synthia("SYNTHIA-"), _synthia(""), DatasetLayout(("ref",), "query")),
        what="A drawn town, driven through in several seasons and lights.",
        page="https://synthia-dataset.net/downloads/",
        download="The video sequences SYNTHIA-SEQS-04-FOG and SYNTHIA-SEQS-04-NIGHT; leave out where the car stands.",
        learned=("fog",),
        recognised="night",
        sampling="About an image a second: every fifth of five a second; of folders ref and query every image.",
        truth="Positions (--positions, a file for each traverse) or --gt, since the drives are no copies of each "
        "other; of folders ref and query image k shows the same place.",
        unsaid="Which camera, and where the section begins: here the left one that looks ahead (Omni_F), from the "
        "first image on.",
        sections=1,
    )
)
DATASETS.register(
    Dataset(
        "st_lucia",
        "St Lucia",
        (
            *(_st_lucia(dash, inner) for inner in ("/webcam_video.avi", "/frames", "") for dash in "_-"),
            DatasetLayout(("ref",), "query"),
        ),
        what="A car's route through a suburb of Brisbane, filmed by a webcam at several times of day.",
        page="https://open.qcr.ai/dataset/st-lucia-multiple/",
        download="The drives 190809_0845 (morning) and 180809_1545 (afternoon) with their GPS; leave out where the "
        "car stands.",
        learned=("morning",),
        recognised="afternoon",
        sampling="A place about every 20 m; of folders ref and query, which somebody has sampled, every image.",
        truth="Positions (--positions, a file for each traverse), since the car drove at different speeds; of folders "
        "ref and query image k shows the same place.",
        unsaid="Where the section begins, and how near the query of a place must be: here from the first image on, "
        "and the query is the nearest image.",
        sections=1,
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


class OpenedDataset(NamedTuple):
    """A dataset as it lies on disk.

    Attributes:
        dataset: Its row.
        layout: How it lies there.
        references: Path of each reference traverse.
        query: Path of the query traverse.
    """

    dataset: Dataset
    layout: DatasetLayout
    references: tuple[Path, ...]
    query: Path

    def sampled(self, traverse: Traverse) -> Traverse:
        """The images of a whole ``traverse`` that are in use; absolute indices stay those of the whole."""
        step = self.layout.step
        return traverse if step == 1 else traverse.take(range(0, len(traverse), step))

    def of_section(self, traverse: Traverse, number: int) -> Traverse:
        """The places of a section.

        Args:
            traverse: All places, an image each.
            number: From 1.
        Raises:
            InputError: the paper has no such section, or the places do not reach so far.
        """
        first, end = self.dataset.section(number)
        if end > len(traverse):
            raise InputError(
                f"{shown(traverse.source)}: gives {len(traverse)} places, section {number} of {self.dataset.title} is "
                f"places {first}:{end}; complete the images, or take an earlier section"
            )
        return traverse.take(range(first, end))


def find_layout(name: str, root: str | Path) -> OpenedDataset:
    """How dataset ``name`` (in `DATASETS`) lies below ``root``.

    Raises:
        InputError: no such dataset is known, or none of its layouts is there; lists the folders looked for.
    """
    dataset = DATASETS[name]
    root = Path(root)
    if not root.is_dir():
        raise InputError(f"{shown(root)}: is not a folder; give the folder that holds the {name} dataset")
    missing = []
    for layout in dataset.layouts:
        paths = [_below(root, folder) for folder in layout.folders]
        present = tuple(path for path in paths if path is not None)
        if len(present) == len(layout.folders):
            return OpenedDataset(dataset, layout, present[:-1], present[-1])
        parts = (f if path is not None else f"{f} (missing)" for f, path in zip(layout.folders, paths, strict=True))
        missing.append(" + ".join(parts))
    raise InputError(f"{shown(root)}: does not hold the {name} dataset; it needs the folders {', or '.join(missing)}")


def check_lengths(opened: OpenedDataset, traverses: Sequence[Traverse]) -> None:
    """Refuse traverses of unequal length where image k shows the same place in each.

    Args:
        opened: The dataset.
        traverses: Whole, some of its traverses.
    Raises:
        InputError: they are.
    """
    if opened.layout.ground_truth == "frames" and len({len(traverse) for traverse in traverses}) > 1:
        lengths = ", ".join(f"{shown(traverse.source)} has {len(traverse)}" for traverse in traverses)
        name = opened.dataset.name
        raise InputError(f"image k must show the same place in every traverse of {name}, but {lengths}; complete them")
