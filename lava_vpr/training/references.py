"""What the references of a model bring to its inputs, and S^R: how often each neuron spikes for each place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse, query_rates, query_rates16
from lava_vpr.engine.blocks import BLOCK, Block, counted, of_integers
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import Shown
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.model import Model, Stretch, integer_model
from lava_vpr.storage.arrays import narrow

_TOGETHER = 1024
"""References whose spikes are counted together."""


def expected_rates(model: Model) -> NDArray[np.float64]:
    """Spikes per step that each input is expected to bring, float64 (inputs,): the mean over all references."""
    rates = query_rates(model.activity, model.config).astype(np.float64)
    return np.asarray(rates.mean(axis=0) / 65536.0)


def references_of(model: Model) -> list[EncodedTraverse]:
    """The reference traverses, each in every view, as far as a model keeps them; thumbnails are those of the first."""
    parts = []
    for start in range(0, len(model.labels), model.places):
        images = slice(start, start + model.places)
        parts.append(
            EncodedTraverse(
                model.place_names,
                model.place_indices,
                model.activity[images],
                None if model.patches is None else model.patches[images],
                model.thumbnails,
                None if model.hog is None else model.hog[images],
                None if model.vectors is None else model.vectors[images],
            )
        )
    return parts


def parts_of(model: Model) -> list[int]:
    """The places of each stretch in a row, as parts that `lava_vpr.training.loop.train` cuts in the same stretches."""
    return [stretch.places for stretch in model.stretches if stretch.view == 0]


def response_keys(rates: NDArray[np.uint16], seed: int) -> NDArray[np.uint64]:
    """Keys of the presentations that measure S^R, one for each reference image with ``rates`` (n, inputs)."""
    return presentation_keys(seed, "response", image_keys(rates))


def shown_references(stretches: Sequence[Stretch], activity: NDArray[np.float32], config: Config) -> tuple[Shown, ...]:
    """The references' rates as queries, stretch after stretch, with the neurons that learned them.

    Args:
        stretches: The parts of the route.
        activity: Input responses to the references, float32 (images, inputs), in the order of `Model.labels`.
        config: Settings of an integer network.
    """
    inputs, views = config.encoder.inputs, len(config.views.views)
    places = sum(part.places for part in stretches) // views
    rates = query_rates16(activity, config.encoder).reshape(-1, views, places, inputs)
    return tuple(
        Shown(
            rates[:, part.view, part.first_place : part.first_place + part.places].reshape(-1, inputs),
            slice(part.first_neuron, part.first_neuron + part.neurons),
        )
        for part in stretches
    )


def measured_responses(model: Model, network: FixedNetwork, pool: Pool) -> NDArray[Any]:
    """S^R of ``network`` on the references that ``model`` keeps, `narrow` (neurons, places), traverses summed."""
    total = _no_responses(network, model.places, len(model.labels) // model.places)
    for rows, counts in _response_counts(network, model.activity, model.config, pool):
        np.add.at(total.T, model.labels[rows], counts.astype(total.dtype))
    return narrow(total)


def reference_responses(
    network: FixedNetwork,
    references: Sequence[EncodedTraverse],
    config: Config,
    pool: Pool,
) -> NDArray[Any]:
    """S^R of the frozen ``network`` on the references, `narrow` (neurons, places), traverses summed."""
    total = _no_responses(network, len(references[0]), len(references))
    for reference in references:
        for rows, counts in _response_counts(network, reference.activity, config, pool):
            total[:, rows] += counts.T.astype(total.dtype)
    return narrow(total)


def _no_responses(network: FixedNetwork, places: int, images: int) -> NDArray[Any]:
    """Counts of 0 (neurons, places), of a type that holds what ``images`` of a place can add up to."""
    most = images * network.steps
    return np.zeros((network.neurons, places), np.uint16 if most <= np.iinfo(np.uint16).max else np.int32)


def _response_counts(
    network: FixedNetwork, activity: NDArray[np.float32], config: Config, pool: Pool
) -> Iterator[tuple[slice, NDArray[np.int32]]]:
    """The spike counts int32 (rows, neurons) of references, some at a time: of a long map, all would not fit."""
    together = _TOGETHER if pool.here else BLOCK
    parts = [slice(start, start + together) for start in range(0, len(activity), together)]

    def block(rows: slice) -> Block:
        rates = query_rates16(activity[rows], config.encoder)
        return Block(rates, response_keys(rates, config.seed))

    asked = map(block, parts)
    found = counted(of_integers, network, asked, pool=pool, total=len(parts))
    for rows, (counts, _) in zip(parts, found, strict=True):
        yield rows, counts


def coverage(responses: NDArray[Any]) -> tuple[int, int]:
    """Neurons with any spike, and places to which some neuron responds most, of counts (neurons, places)."""
    used = responses.any(axis=1)
    return int(used.sum()), len(np.unique(responses[used].argmax(axis=1)))


def remeasured(model: Model, pool: Pool) -> Model:
    """``model`` with its network's responses to the references, as training measures them, and no calibration.

    Raises:
        ConfigError: the model is the float conductance model.
    """
    responses = measured_responses(model, integer_model(model, "responses").network, pool)
    used, covered = coverage(responses)
    figures = {
        "spikes_per_image": float(responses.sum() / len(model.labels)),
        "neurons_used": used,
        "places_covered": covered,
    }
    return replace(model, responses=responses, training={**model.training, **figures}, calibration=None)
