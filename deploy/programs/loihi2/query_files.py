"""Queries and references as they are read, results as they are written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bundle_files import array_of
from lava_network import Arrays
from references import check_biases, check_queries, first_places
from refusals import Refused
from result_files import ResultFiles


def named_array(data: bytes, name: object) -> NDArray[Any]:
    """The array in the content of a ``.npy`` file."""
    try:
        return array_of(data)
    except (ValueError, EOFError, OSError):
        raise Refused("input", f"{name}: is no array; write it with numpy.save") from None


def load_queries(folder: Path, inputs: int, neurons: int) -> Arrays:
    """Rates and keys in a folder; biases and exponents, if it has them."""
    arrays, biases = {}, ("biases", "exponents") if (folder / "biases.npy").exists() else ()
    for name in ("rates", "keys", *biases):
        path = folder / f"{name}.npy"
        try:
            arrays[name] = named_array(path.read_bytes(), path)
        except OSError as error:
            raise Refused("input", f"{path}: cannot be read ({error.strerror}); write the queries there") from None
    check_queries(arrays["rates"], arrays["keys"], inputs, folder)
    if biases:
        check_biases(arrays["biases"], arrays["exponents"], (len(arrays["keys"]), neurons), folder)
    return arrays


def load_references(files: dict[str, bytes], n: int, inputs: int) -> tuple[Arrays, NDArray[np.int64]]:
    """The first ``n`` references (0: all), and the places of which all images are among them."""
    rates, keys, labels = (named_array(files[f"host/{name}.npy"], name) for name in ("rates", "keys", "labels"))
    check_queries(rates, keys, inputs, "host")
    n, places = first_places(labels, n)
    return {"rates": rates[:n], "keys": keys[:n], "labels": labels[:n]}, places


class Results(ResultFiles):
    """Counts, and which are answered; in files, if there is a folder."""

    def __init__(self, n: int, neurons: int, folder: str) -> None:
        super().__init__(n, neurons, folder)
        self.save()

    def add(self, start: int, counts: NDArray[np.int32]) -> None:
        """Counts of the queries from ``start`` on."""
        wanted = self.counts[start : start + len(counts)].shape
        if counts.shape != wanted or (counts < 0).any():
            raise Refused("run", f"query {start}: impossible spike counts {counts.shape}; run it again")
        self.counts[start : start + len(counts)], self.done[start : start + len(counts)] = counts, True
        self.save()

    def save(self, stage: str = "", error: str = "") -> None:
        """Replace the files."""
        try:
            super().save(stage, error)
        except OSError as problem:
            raise Refused("input", f"{self.folder}: cannot be written ({problem.strerror}); name another") from None
