"""The figures of a matcher by name: keys in JSON, titles in tables, and the three that experiments keep."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from lava_vpr.matching.evaluation import Metrics

TITLES: Mapping[str, str] = {
    "recall_at_1": "R@1",
    "recall_at_5": "R@5",
    "recall_at_10": "R@10",
    "recall_at_100_precision": "R@100P",
    "precision_at_100_recall": "P@100R",
    "auc": "AUC",
}
"""Titles of all figures, by their keys, in the order of tables."""


class Recall(NamedTuple):
    """The figures that experiments keep of a matcher, fractions in 0..1."""

    recall_at_1: float
    recall_at_100_precision: float
    auc: float

    @classmethod
    def of(cls, metrics: Metrics) -> Recall:
        """Those of ``metrics``."""
        return cls(metrics.recall_at_1, metrics.recall_at_100_precision, metrics.auc)


def titles(keys: Iterable[str] = Recall._fields) -> tuple[str, ...]:
    """The titles of some figures, by default of those of `Recall`."""
    return tuple(TITLES[key] for key in keys)


def values_of(metrics: Any, keys: Iterable[str] = TITLES) -> tuple[float | None, ...]:
    """The figures of a `Metrics`, or of what is like one, by their keys; None where a rank was not counted."""
    by_rank = {f"recall_at_{n}": value for n, value in metrics.recall_at_n.items()}
    return tuple(getattr(metrics, key, by_rank.get(key)) for key in keys)
