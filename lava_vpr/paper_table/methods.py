"""The rows of the table, the paper's six methods and those of this package beside them, and the numbers that it prints.

Source: Hussaini, Milford, Fischer, "Spiking Neural Networks for Visual Place Recognition via Weighted Neuronal
Assignments", RA-L 2022, table I: mean recall at 100 % precision, in percent."""

from __future__ import annotations

from dataclasses import dataclass

from lava_vpr.errors import ConfigError
from lava_vpr.rows.registry import Registry

DESCRIPTORS = "descriptors"
"""What a method belongs to that compares vectors of another program: no network is learned for it."""


@dataclass(frozen=True)
class Method:
    """A row of the table.

    Attributes:
        name: Its name in files.
        title: What tables call it.
        network: The preset that is learned for it, or `DESCRIPTORS`; its baselines come with that, on the same images.
        matcher: The decoder or baseline that answers.
    """

    name: str
    title: str
    network: str
    matcher: str


METHODS: Registry[Method] = Registry("method", ConfigError)
"""The methods by name, in the order of the table: the paper's columns first."""
for _method in (
    Method("standard", "standard", "paper", "standard"),
    Method("weighted", "weighted", "paper", "weighted"),
    Method("probability", "probability", "paper", "probability"),
    Method("weighted_probability", "weighted probability", "paper", "weighted_probability"),
    Method("netvlad", "NetVLAD", DESCRIPTORS, "descriptors"),
    Method("sad", "SAD", "loihi", "sad"),
    Method("loihi", "preset loihi", "loihi", "contrast"),
    Method("fast", "preset fast", "fast", "contrast"),
    Method("template", "loihi without learning", "loihi", "template"),
    Method("cosine", "cosine of inputs", "loihi", "cosine"),
    Method("hog", "HOG", "loihi", "hog"),
):
    METHODS.register(_method)

NETWORKS = ("loihi", "fast", DESCRIPTORS, "paper")
"""What is learned, the quick ones first: a minute of all sections of Nordland, then half an hour."""


def of_network(network: str) -> tuple[Method, ...]:
    """The methods that belong to a network."""
    return tuple(method for method in METHODS.values() if method.network == network)


DOI = "10.1109/LRA.2022.3149030"

COLUMNS = ("standard", "weighted", "probability", "weighted_probability", "netvlad", "sad")
"""The methods, in the order of the printed columns."""

PRINTED: dict[str, tuple[float, ...]] = {
    "nordland": (12.8, 29.7, 38.2, 47.5, 15.3, 51.7),
    "oxford": (2.5, 8.8, 4.8, 12.0, 11.0, 11.3),
    "spedtest": (10.2, 19.8, 29.5, 18.7, 15.2, 7.7),
    "synthia": (1.0, 4.0, 22.0, 16.0, 15.0, 19.0),
    "st_lucia": (12.0, 22.0, 13.0, 22.0, 6.0, 0.0),
}
"""The printed rows, by the name of their dataset in `lava_vpr.datasets.layouts.DATASETS`."""


def printed(dataset: str, method: str) -> float | None:
    """What the paper prints of a method on a dataset, in percent; None if it prints nothing."""
    if method not in COLUMNS or dataset not in PRINTED:
        return None
    return PRINTED[dataset][COLUMNS.index(method)]
