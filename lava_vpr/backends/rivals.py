"""Rivals: baselines that are compared with the answering decoder, on the same queries.

* ``sad`` and ``hog`` compare the images themselves, patch-normalised ones of 28 x 28 pixels and HOG descriptors of 64 x
  64; ``cosine`` compares the network's own input rates (`lava_vpr.matching.baselines`).
* ``vectors`` and ``standardised`` compare the vectors of a model that learned vectors, as given and with the mean of
  the references subtracted: their cosines show how much recall inputs and spikes cost.
* ``template`` is the network without learning: the references' rates as weights, one neuron a place, the same inputs,
  spikes, integers and decoder (`lava_vpr.training.templates`), on the host engine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial, reduce
from operator import or_
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.asking import PLAINLY, Asking, adapted_scores, summed
from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.encoding import EncodedTraverse, Keep
from lava_vpr.engine.adaptation import Adaptation
from lava_vpr.engine.inference.direct import strengths
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import ConfigError, InputError, shown
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.matching import baselines, decoders
from lava_vpr.matching.against_truth import InBlocks
from lava_vpr.model import IntegerModel, Model, as_integer
from lava_vpr.vectors.files import load_descriptors

BASELINES = {
    "sad": "patch-normalised images of 28x28 pixels",
    "cosine": "the network's own input rates",
    "hog": "grey images of 64x64 pixels",
    "template": "the network's own input spikes, without learning",
    "vectors": "the vectors as they were given",
    "standardised": "the vectors, standardised on the references",
}
"""The part of an image that each baseline compares, in words, by its name."""
_COMPARED = {
    "sad": ("SAD", Keep.PATCHES),
    "hog": ("HOG", Keep.HOG),
    "vectors": ("vectors", Keep.VECTORS),
    "standardised": ("standardised", Keep.VECTORS),
}
"""The name in messages of each baseline that compares more than activity, and the arrays that it needs."""


def descriptor_similarities(
    ref_npy: Path,
    query_npy: Path,
    *,
    n_references: int | None = None,
    n_queries: int | None = None,
    labels: NDArray[Any] | None = None,
) -> NDArray[np.float64]:
    """Cosine similarity of descriptors in two .npy files.

    Args:
        ref_npy: File with one row for each reference image.
        query_npy: File with one row for each query.
        n_references, n_queries: How many rows each must have, if known.
        labels: As in `lava_vpr.matching.baselines.sad_distances`.
    Returns:
        Similarities (n_queries, n_places), the largest over a place's images; 0 for an all-zero descriptor.
    Raises:
        InputError: as `load_descriptors`, naming the file; or descriptors of different dimensions.
    """
    references, queries = load_descriptors(ref_npy, n_references), load_descriptors(query_npy, n_queries)
    if references.shape[1] != queries.shape[1]:
        raise InputError(
            f"{shown(query_npy)}: descriptors of {queries.shape[1]} dimensions, but {shown(ref_npy)} has "
            f"{references.shape[1]}; compute both with the same network"
        )
    return baselines.cosine_similarities(references, queries, labels)


def strange(model: Model) -> dict[str, str]:
    """Baselines of vectors that do not apply to ``model``: the reason for each, by name."""
    row = INPUTS[model.config.encoder.kind]
    if row.sees != "vector":
        vectors = [name for name in BASELINES if kept_for((name,)) == Keep.VECTORS]
        return dict.fromkeys(vectors, "the model learned images; it compares vectors")
    return {} if row.standardised else {"standardised": f"inputs {row.name!r} take vectors as they are"}


def missing(model: Model) -> dict[str, str]:
    """Baselines that apply to ``model`` but cannot be computed: the reason for each, by name.

    Those that do not apply are in `strange`.
    """
    reasons = {}
    if model.vectors is not None:
        reasons = {name: "the model learned vectors; it compares images" for name in ("sad", "hog")}
    elif model.hog is None:
        reasons["hog"] = "the model keeps no HOG descriptors of its references; train it again"
    if as_integer(model) is None:
        reasons["template"] = "preset paper is the float conductance model, templates are an integer network's"
    return reasons


def chosen(model: Model, wanted: Sequence[str] | None) -> tuple[str, ...]:
    """The names of the baselines to compare ``model`` with.

    Args:
        model: The model that answers.
        wanted: Names in `BASELINES`; None: all that can be computed.
    Raises:
        ConfigError: a wanted baseline cannot be computed.
    """
    reasons = missing(model) | strange(model)
    if wanted is None:
        return tuple(name for name in BASELINES if name not in reasons)
    for name in wanted:
        if name in reasons:
            raise ConfigError(f"baseline {name}: {reasons[name]}")
    return tuple(wanted)


def kept_for(names: Sequence[str]) -> Keep:
    """The parts of query images that encoding must keep, beside activity, for the baselines ``names``."""
    return reduce(or_, (_COMPARED[name][1] for name in names if name in _COMPARED), Keep.NOTHING)


def compared(model: Model, queries: EncodedTraverse, name: str) -> tuple[NDArray[Any], NDArray[Any]]:
    """The arrays of images or vectors that the baseline ``name`` compares: the queries', and the references'."""
    called, kept = _COMPARED[name]
    pair = queries.kept(kept, called), np.asarray(getattr(model, str(kept.name).lower()))
    if name != "standardised" or model.standard is None:
        return pair
    return model.standard.standardised(pair[0]), model.standard.standardised(pair[1])


class Scored(NamedTuple):
    """Scores of a decoder or a rival.

    Attributes:
        name: Its name in `DECODERS` or `BASELINES`.
        matcher: Name of the decoder or matcher that gives its answers' confidence.
        scores: Scores of the queries.
    """

    name: str
    matcher: str
    scores: InBlocks


def decoded(model: Model, counts: NDArray[Any], name: str) -> InBlocks:
    """Scores of spike counts (n, neurons) by the decoder ``name``, computed when they are read."""
    prepared = cache(partial(decoders.prepare, name, model.responses, gamma=model.config.decoder.gamma))
    return InBlocks(len(counts), model.places, lambda rows: prepared()(counts[rows]))


@dataclass(frozen=True)
class Rivals:
    """The baselines of a model on its queries; scores are computed when they are read.

    Attributes:
        model: The model that answers.
        queries: The query images.
        shown: The presentations of the queries, view after view.
        names: Names of the baselines, as `chosen` returns them.
        asking: How queries are asked.
        pool: Counts the spikes.
    """

    model: Model = field(repr=False)
    queries: EncodedTraverse = field(repr=False)
    shown: Presentations = field(repr=False)
    names: tuple[str, ...]
    asking: Asking = PLAINLY
    pool: Pool = ONE_THREAD

    @cached_property
    def template(self) -> IntegerModel:
        """The model with templates of its references as weights."""
        from lava_vpr.training.templates import template_of  # a slow import, which answers do not need

        return template_of(self.model, self.pool)

    @property
    def _rates(self) -> NDArray[Any]:
        """Input rates of the queries in the straight view, (n, inputs)."""
        return self.shown.rates[: len(self.queries)]

    def scored(self, tau: float | None = None) -> Iterator[Scored]:
        """The scores of each baseline in turn; with ``tau``, adapted to earlier queries with that time constant."""
        for name in self.names:
            if name == "template":
                decoder, counts = self.template.config.decoder.default, self._of_template(tau)
                yield Scored(name, decoder, decoded(self.template, counts, decoder))
                continue
            seen, references = self.seen(name)
            scores = InBlocks(len(seen), self.model.places, partial(self._similar, name, references, seen))
            if tau is not None:
                similar, own = (self._similar(name, references, items) for items in (seen, references))
                scores = InBlocks.made(adapted_scores(similar, own.mean(axis=0), self._rates, tau))
            yield Scored(name, name, scores)

    def _of_template(self, tau: float | None) -> NDArray[np.int32]:
        """The spike counts (n, neurons) of the network without learning."""
        shown = self.shown
        if tau is not None:
            bias = Adaptation(self.template.network, tau).biases(self._rates)
            shown = replace(shown, bias=np.tile(bias, (self.asking.views, 1)))
        counts, _ = HostBackend(self.pool).count_spikes(self.template, shown)
        return summed(counts, self.asking.views)

    def seen(self, name: str) -> tuple[NDArray[Any], NDArray[Any]]:
        """The items that a baseline other than ``template`` compares: the queries', and the references'."""
        if name in _COMPARED:
            return compared(self.model, self.queries, name)
        pair = self._rates, query_rates(self.model.activity, self.model.config)
        seen, references = (strengths(rates, self.model.config.encoder.direct is not None) for rates in pair)
        return seen, references

    def _similar(
        self, name: str, references: NDArray[Any], seen: NDArray[Any], rows: slice = slice(None)
    ) -> NDArray[np.float64]:
        """The scores, float64 (n, places), of ``rows`` of ``seen``, the queries' items of the baseline ``name``."""
        if name == "sad":
            return -baselines.sad_distances(references, seen[rows], self.model.labels)
        return baselines.cosine_similarities(references, seen[rows], self.model.labels)
