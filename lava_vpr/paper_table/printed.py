"""The numbers that the paper prints: mean recall at 100 % precision, in percent.

Source: Hussaini, Milford, Fischer, "Spiking Neural Networks for Visual Place Recognition via Weighted Neuronal
Assignments", RA-L 2022, table I.
"""

from __future__ import annotations

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
