"""The data of an evaluation report: plain arrays and texts, checked once, without reference to files or models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lava_vpr.inputs.encoder import ChannelLayout
from lava_vpr.matching.decoders import DECODERS, MATCHERS
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.matching.trust import Trust
from lava_vpr.report.layers import Layers
from lava_vpr.report.season import Trusted
from lava_vpr.show.numbers import named


@dataclass(frozen=True, eq=False)
class Raster:
    """The excitatory spikes of one query.

    Attributes:
        query: Index of the query.
        place: Index of the matched place, -1 for none.
        true_place: Index of the place where the query was taken, None if there is none.
        steps: Steps of the presentation, the silent ones included.
        neurons: Excitatory neurons.
        spike_steps, spike_neurons: Step (0..steps - 1) and neuron of every spike, int, shape (spikes,).
        input_spikes: Input spikes of the presentation.
    """

    query: int
    place: int
    true_place: int | None
    steps: int
    neurons: int
    spike_steps: NDArray[np.integer[Any]]
    spike_neurons: NDArray[np.integer[Any]]
    input_spikes: int


@dataclass(frozen=True, eq=False)
class MapData:
    """Where places and queries were taken, in metres on one plane.

    Attributes:
        places: Shape (n_places, 2), east and north.
        queries: Shape (n_queries, 2).
        figures: The metres of error in words, plain text; empty if they are not known.
    """

    places: NDArray[np.float64]
    queries: NDArray[np.float64]
    figures: str


@dataclass(frozen=True, eq=False)
class ReportData:
    """The data of the evaluation report.

    Attributes:
        title: Heading of the page.
        command: Command line that reproduces the figures.
        summary: Short facts by name ("neurons": "100"), in order.
        default_decoder: Key of `metrics` and of `matrices` whose matches the report is about.
        metrics: Figures by matcher: the decoders, and the baselines ``sad``, ``cosine``, ``hog``,
            ``template``, ``descriptors``.
        matrices: Scores by matcher, shape (n_queries, n_places), higher is better.
        truth: Where each query was taken, bool, shape (n_queries, n_places).
        matches: Place that the default decoder gives each query, -1 for none, int, shape (n_queries,).
        confidence: Confidence of those matches, shape (n_queries,).
        place_names, query_names: File names, or other names of the images.
        place_thumbnails, query_thumbnails: uint8 (n, h, w, 3), BGR.
        input_layout: How the inputs are arranged.
        drawing, legend: How the weights of a neuron are drawn, and the legend; see `Input`.
        weights: Shape (inputs, n_exc), inputs ordered as `input_layout` says, or None if the weights are not to be
            shown.
        neuron_places: The place that each excitatory neuron represents most, -1 for none, int, shape (n_exc,).
        rasters: Spikes of a few queries.
        events: Counted events per query, by the names of ``lava-vpr bench``.
        config_toml: The model's configuration.
        seen: The part of an image that each baseline among `metrics` compares, in words, by its name.
        place_numbers, query_numbers: Absolute index of each image in its own sequence.
        map: Where places and queries were taken; None if that is not known.
        trust: How well probabilities agree with the truth, by way of answering, ``single`` and ``filtered``; empty if
            no probabilities are known.
        followed: Figures of a filter, ``filtered`` and ``forward_backward``; empty if there was none.
        changed: Figures of matchers where the network adapts, and where inputs have gains, by matcher and way.
        season: The gains after the last query; None if all inputs count alike.
        layers: The spikes of the front end for one query; None without a spiking front end.
    """

    title: str
    command: str
    summary: dict[str, str]
    default_decoder: str
    metrics: Mapping[str, Metrics]
    matrices: Mapping[str, NDArray[Any]]
    truth: NDArray[np.bool_]
    matches: NDArray[np.integer[Any]]
    confidence: NDArray[Any]
    place_names: tuple[str, ...]
    query_names: tuple[str, ...]
    place_numbers: tuple[int, ...]
    query_numbers: tuple[int, ...]
    place_thumbnails: NDArray[np.uint8]
    query_thumbnails: NDArray[np.uint8]
    input_layout: ChannelLayout
    drawing: Literal["strokes", "grey"]
    legend: str
    weights: NDArray[Any] | None
    neuron_places: NDArray[np.integer[Any]]
    rasters: tuple[Raster, ...]
    events: Mapping[str, float]
    config_toml: str
    seen: Mapping[str, str] = field(default_factory=dict)
    map: MapData | None = None
    trust: Mapping[str, Trust] = field(default_factory=dict)
    followed: Mapping[str, Metrics] = field(default_factory=dict)
    changed: Mapping[tuple[str, str], Metrics] = field(default_factory=dict)
    season: Trusted | None = None
    layers: Layers | None = None

    def __post_init__(self) -> None:
        queries, places = len(self.query_names), len(self.place_names)
        _check("metrics", self.default_decoder in self.metrics, f"must hold {self.default_decoder!r}")
        for name, array, shape in (
            ("truth", self.truth, (queries, places)),
            *((f"matrices[{name!r}]", matrix, (queries, places)) for name, matrix in self.matrices.items()),
            ("matches", self.matches, (queries,)),
            ("confidence", self.confidence, (queries,)),
        ):
            _check(name, array.shape == shape, f"must have shape {shape}")
        in_range = bool(np.all((self.matches >= -1) & (self.matches < places)))
        _check("matches", in_range, f"must lie in -1..{places - 1}")
        for kind, length in (("place", places), ("query", queries)):
            _check(f"{kind}_numbers", len(getattr(self, f"{kind}_numbers")) == length, f"must hold {length} numbers")
            images = getattr(self, f"{kind}_thumbnails")
            good = images.ndim == 4 and len(images) == length and images.shape[3] == 3 and images.dtype == np.uint8
            _check(f"{kind}_thumbnails", good, f"must be uint8 of shape ({length}, h, w, 3)")
        if self.map is not None:
            for name, points, length in (("places", self.map.places, places), ("queries", self.map.queries, queries)):
                good = points.shape == (length, 2) and bool(np.isfinite(points).all())
                _check(f"map.{name}", good, f"must be finite, of shape ({length}, 2)")
        if self.weights is not None:
            known = self.drawing == "strokes" or self.input_layout.channels in (1, 2)
            _check("input_layout", known, "must have one or two channels to be drawn in grey")
            shape = (self.input_layout.inputs, len(self.neuron_places))
            _check("weights", self.weights.shape == shape, f"must have shape {shape}")


def _check(name: str, condition: bool, requirement: str) -> None:
    """Refuse arrays that do not belong together, a defect of the caller that no user can cause.

    Raises:
        ValueError: the condition does not hold.
    """
    if not condition:
        raise ValueError(f"ReportData.{name} {requirement}")


_EVENTS = {
    "synaptic_operations": "synaptic operations",
    "neuron_updates": "neuron updates",
    "input_spikes": "input spikes",
    "exc_spikes": "excitatory spikes",
    "inh_spikes": "inhibitory spikes",
}


def label(name: str) -> str:
    """The name of a matcher or a counted event in the report."""
    for matchers in (DECODERS, MATCHERS):
        if name in matchers:
            return str(matchers[name].title)
    return _EVENTS.get(name, named(name))
