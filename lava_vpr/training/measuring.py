"""Measurements on a model's own references only: the reference responses S^R, and margins of answers.

S^R holds how often each neuron spikes for each place. Margins of answers that are right, wrong and off the map
calibrate the probabilities.

On the map: references in which a share `ALTERED` of the inputs, drawn again for each, take their values in other
references, one drawn for each input. The share models a change of season: of shares from 0.6 to 0.95 it had the least
calibration error on Nordland 0:200, learned in either season and queried in the other, with half of the queries off the
map. References that are vectors are altered by each of `SHARES` in turns. Where all queries are on the map, the
probabilities depend on how often a place is mistaken for another, which nearly never happens to references altered by
`ALTERED`; for images they are measured on references altered by each of `SHARES`, in every other turn also
`seen_otherwise`. These shares were chosen on the same images and on halves of them, among 15 sets of shares between 0.4
and 0.95 with all, half or none of the images seen otherwise. Three sets gave the observed right and wrong answers the
highest likelihood, equal within 0.0004 a query; of these the one that vectors use was taken. None of the sets suits
Gardens Point 0:50, whose views change.

Off the map: references shown to the network without the neurons of their quarter of the route. The route is cut into
quarters twice, the second time half a quarter further on, and only the middle half of each quarter is shown, since
neighbours outside would recognise the places near its ends.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.blocks import BLOCK, Block, counted, of_integers
from lava_vpr.engine.inference.direct import strengths
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.surroundings import Shown
from lava_vpr.engine.random import image_keys, presentation_key, presentation_keys, uniform
from lava_vpr.engine.rates import query_rates, query_rates16
from lava_vpr.inputs.encoder import INPUTS, ChannelLayout
from lava_vpr.inputs.front_end import BURST
from lava_vpr.matching import decoders
from lava_vpr.matching.decoders import best, margin
from lava_vpr.matching.probability import OFF_MAP, RIGHT, VARIED_RIGHT, VARIED_WRONG, WRONG, Calibration
from lava_vpr.model import IntegerModel, Model, Stretch, as_integer, integer_model
from lava_vpr.storage.arrays import narrow

ALTERED = 0.8
"""Share of the inputs of an image that are altered."""
SHARES = (0.7, 0.8, 0.9)
"""Shares of the inputs of an image, and of the values of a vector, that are altered in turns. Those of vectors were
chosen on Nordland 0:200 in both directions with half of the queries off the map, for HOG and for projected dense
HOG."""
LIGHT = (0.4, 1.6)
"""Relative change of the inputs' responses from one side to the other of an image that is lit from a side."""
SAMPLES = 500
"""Most samples, about, on the map, and as many off it; no reference is used more than `_REPEATS` times."""
_PARTS, _SHIFTS, _REPEATS = 4, 2, 4


def calibrated(model: Model, pool: Pool = ONE_THREAD) -> Model:
    """``model`` with its calibration, to be saved with it; unchanged if its network is the float conductance model.

    Args:
        model: A model.
        pool: Who asks the networks; it does not change the result.
    """
    integer = as_integer(model) if model.calibration is None else None
    return model if integer is None else replace(model, calibration=measured(integer, pool).samples)


def measured(model: IntegerModel, pool: Pool = ONE_THREAD) -> Calibration:
    """The calibration of ``model``, measured on its references.

    Args:
        model: A model whose network is one of integers.
        pool: Who asks the networks; it does not change the result.
    """
    asked = on_map(model)
    repeats = len(asked)
    asked += [_off_map(model, number, *part, repeats) for number, part in enumerate(_without_parts(model))]
    if INPUTS[model.config.encoder.kind].sees != "vector":
        asked += _varied(model, repeats * (1 + _PARTS * _SHIFTS))
    return Calibration(answered(model, asked, pool).astype(np.float32))


class Question(NamedTuple):
    """Presentations to a network whose right answers are known.

    Attributes:
        places: The place that each presentation shows, int64 (presentations,); -1: no place of the network.
        block: Makes the presentations.
        scores: Computes the scores of the places from spike counts.
        kinds: The `KINDS` of a right and of a wrong answer.
    """

    places: NDArray[np.int64]
    block: Callable[[], Block]
    scores: Callable[[NDArray[np.int32]], NDArray[np.float64]]
    kinds: tuple[float, float] = (RIGHT, WRONG)

    def samples(self, counts: NDArray[np.int32]) -> NDArray[np.float64]:
        """Margins of the answers that spike counts give, and the `KINDS` of each, float64 (presentations, 2)."""
        scores = self.scores(counts)
        kinds = np.where(best(scores) == self.places, *self.kinds)
        return np.stack([margin(scores), np.where(self.places < 0, OFF_MAP, kinds)], axis=1)


def answered(model: IntegerModel, asked: Sequence[Question], pool: Pool = ONE_THREAD) -> NDArray[np.float64]:
    """The samples of all questions, one after another, float64 (presentations, 2)."""
    size = BLOCK if not pool.here else SAMPLES * _REPEATS
    cuts = [-(-len(question.places) // size) for question in asked]
    blocks = (part for question in asked for part in question.block().parts(size))
    counts = counted(of_integers, model.network, blocks, pool=pool, total=sum(cuts))
    samples = [
        question.samples(np.concatenate([some for some, _ in islice(counts, cut)]))
        for question, cut in zip(asked, cuts, strict=True)
    ]
    return np.concatenate(samples)


def on_map(model: IntegerModel) -> list[Question]:
    """Altered references for the whole network, each repetition with its own noise. Networks that learned equal
    references with equal settings of inputs and seed get the same ones."""
    vectors = INPUTS[model.config.encoder.kind].sees == "vector"
    shares, channels = (SHARES, model.config.encoder.layout.channels) if vectors else ((ALTERED,), 1)
    return _altered(model, lambda places, repeat: _in_turns(model, places, repeat, shares, channels))


def _varied(model: IntegerModel, first: int) -> list[Question]:
    """References altered by different shares, and seen otherwise in every other turn; noise from ``first`` on."""

    def shown(places: NDArray[np.int64], turn: int) -> NDArray[np.float32]:
        made = _in_turns(model, places, first + turn, SHARES, 1)
        return seen_otherwise(made, model.config.encoder.layout, (np.arange(len(places)) + turn) * (turn % 2))

    asked = _altered(model, shown, first)
    return [question._replace(kinds=(VARIED_RIGHT, VARIED_WRONG)) for question in asked]


def _altered(
    model: IntegerModel, shown: Callable[[NDArray[np.int64], int], NDArray[np.float32]], first: int = 0
) -> list[Question]:
    """References for the whole network, altered by ``shown`` for places and turn; noise from ``first`` on."""
    repeats = min(_REPEATS, max(2, -(-SAMPLES // model.places)))
    places = np.unique(np.linspace(0, model.places - 1, min(model.places, SAMPLES)).astype(np.int64))
    scores = partial(scores_of, model, model.responses)

    def block(turn: int) -> Block:
        return _block(model, shown(places, turn), first + turn)

    return [Question(places, cache(partial(block, turn)), scores) for turn in range(repeats)]


def _in_turns(
    model: IntegerModel, places: NDArray[np.int64], repeat: int, shares: tuple[float, ...], channels: int
) -> NDArray[np.float32]:
    """References of the first traverse, straight ahead, altered by each of ``shares`` in turns."""
    share = np.array(shares)[(np.arange(len(places)) + repeat) % len(shares)]
    return altered(model.activity[: model.places], places, model.config.seed, repeat, share, channels)


def _off_map(
    model: IntegerModel,
    number: int,
    kept: NDArray[np.bool_],
    inside: NDArray[np.bool_],
    left_out: NDArray[np.int64],
    repeats: int,
) -> Question:
    """References for the network without the neurons of their part of the route."""
    chosen = left_out[:: max(1, len(left_out) * _PARTS * _SHIFTS // SAMPLES)]

    def block() -> Block:
        first = repeats * (1 + number)
        shown = [_block(model, model.activity[chosen], first + k) for k in range(repeats)]
        keys = np.concatenate([one.keys for one in shown])
        return Block(np.concatenate([one.rates for one in shown]), keys, kept=kept)

    def scores(counts: NDArray[np.int32]) -> NDArray[np.float64]:
        return scores_of(model, np.ascontiguousarray(model.responses[kept][:, ~inside]), counts)

    return Question(np.full(len(chosen) * repeats, -1), block, scores)


def altered(
    activity: NDArray[np.float32],
    places: NDArray[np.int64],
    seed: int,
    repeat: int,
    share: float | NDArray[np.float64] = ALTERED,
    channels: int = 1,
) -> NDArray[np.float32]:
    """References at ``places`` in which a share of the inputs take the values of another reference.

    Args:
        activity: Input responses to all references, float32 (references, inputs).
        places: Which references are altered, int64 (n,).
        seed: Seed of the draws.
        repeat: The number of the repetition; each has its own draws.
        share: The share of the inputs, in [0, 1], of all or of each reference (n,).
        channels: Number of inputs altered together, one of each channel, such as ON and OFF of a value of a vector.
    Returns:
        float32 (n, inputs).
    """
    references, inputs = activity.shape
    points = inputs // channels
    made = np.empty((len(places), inputs), np.float32)
    for row, place, least in zip(made, places, np.broadcast_to(share, len(places)), strict=True):
        draws = uniform(presentation_key(seed, "calibration", int(place), repeat), 2 * points)
        others = np.tile((draws[points:] * references).astype(np.int64), channels)
        changed = np.tile(draws[:points] < least, channels)
        row[:] = np.where(changed, activity[others, np.arange(inputs)], activity[place])
    return made


def seen_otherwise(
    activity: NDArray[np.float32], layout: ChannelLayout, turns: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Images in four turns: unchanged, shifted by half a cell, lit from a side, with a corner covered.

    Args:
        activity: Input responses to the images, float32 (n, inputs).
        layout: The inputs.
        turns: Turn of each image modulo four; the turn divided by four selects the side; int64 (n,).
    Returns:
        float32 (n, inputs).
    """
    made = activity.reshape(-1, layout.channels, layout.grid, layout.grid).copy()
    light = np.linspace(*LIGHT, layout.grid, dtype=np.float32)
    for image, turn in zip(made, turns, strict=True):
        seen = np.rot90(image, turn // 4, (1, 2))  # a view: what is written to it, ``image`` has
        if turn % 4 == 1:
            seen[..., 1:] = (seen[..., 1:] + seen[..., :-1]) / 2
        elif turn % 4 == 2:
            seen *= light
        elif turn % 4 == 3:
            seen[:, : layout.grid // 2, : layout.grid // 2] = 0
    return made.reshape(activity.shape)


def _block(model: IntegerModel, activity: NDArray[np.float32], repeat: int) -> Block:
    """Images with ``activity``, with the noise of this repetition."""
    rates = query_rates16(activity, model.config.encoder)
    return Block(rates, presentation_keys(model.config.seed, "calibration", image_keys(rates), repeat))


def scores_of(model: IntegerModel, responses: NDArray[Any], counts: NDArray[np.int32]) -> NDArray[np.float64]:
    """Scores by the model's own decoder, of places with these ``responses``."""
    decoder = model.config.decoder
    return decoders.decode(decoder.default, responses, counts, gamma=decoder.gamma)


def _without_parts(model: IntegerModel) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.int64]]]:
    """For each part of the route: the neurons outside it, its places, and those in its middle."""
    places = model.places
    parts = min(_PARTS, places)
    size, neuron_places = places / parts, model.neuron_places()
    for shift in range(_SHIFTS):
        along = ((np.arange(places) + 0.5) / size + shift / _SHIFTS) % parts
        middle = np.abs(along % 1.0 - 0.5) <= 0.25
        for part in range(parts):
            inside = along.astype(np.int64) == part
            kept = (neuron_places < 0) | ~inside[neuron_places]
            left_out = np.flatnonzero(inside & middle)
            if len(left_out) == 0 or not kept.any():
                continue
            yield kept, inside, left_out


_TOGETHER = 1024
"""References whose spikes are counted together."""


def expected_rates(model: Model) -> NDArray[np.float64]:
    """Spikes per step that each input is expected to bring, float64 (inputs,): the mean over all references."""
    rates = query_rates(model.activity, model.config)
    if (before := model.config.encoder.direct) is not None:
        return np.asarray((rates % BURST).mean(axis=0) / before.ticks)
    return np.asarray(rates.astype(np.float64).mean(axis=0) / 65536.0)


def references_of(model: Model) -> list[EncodedTraverse]:
    """The reference traverses in every view, as far as a model stores them; thumbnails are those of the first."""
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
    rates = query_rates16(activity, config.encoder)
    rates = strengths(rates, config.encoder.direct is not None).reshape(-1, views, places, inputs)
    return tuple(
        Shown(
            rates[:, part.view, part.first_place : part.first_place + part.places].reshape(-1, inputs),
            slice(part.first_neuron, part.first_neuron + part.neurons),
            len(rates),
        )
        for part in stretches
    )


def reference_responses(
    network: FixedNetwork, activity: NDArray[np.float32], places: int, config: Config, pool: Pool
) -> NDArray[Any]:
    """S^R of the frozen ``network`` on the references, `narrow` (neurons, places), traverses summed.

    Args:
        network: The network.
        activity: Input responses to the references, traverse after traverse, float32 (images, inputs).
        places: Images of a traverse.
        config: Settings.
        pool: Who counts the spikes.
    """
    most = len(activity) // places * network.steps
    total: NDArray[Any] = np.zeros(
        (network.neurons, places), np.uint16 if most <= np.iinfo(np.uint16).max else np.int32
    )
    together = _TOGETHER if pool.here else BLOCK  # of a long map, the counts of all would not fit
    cuts = [slice(start, min(start + together, places)) for start in range(0, places, together)]
    parts = [(traverse, cut) for traverse in activity.reshape(-1, places, activity.shape[1]) for cut in cuts]

    def block(traverse: NDArray[np.float32], cut: slice) -> Block:
        rates = query_rates16(traverse[cut], config.encoder)
        return Block(rates, response_keys(rates, config.seed))

    found = counted(of_integers, network, itertools.starmap(block, parts), pool=pool, total=len(parts))
    for (_, cut), (counts, _) in zip(parts, found, strict=True):
        total[:, cut] += counts.T.astype(total.dtype)
    return narrow(total)


def coverage(responses: NDArray[Any]) -> tuple[int, int]:
    """Number of neurons with any spike, and of places that are some neuron's strongest response, from counts (neurons,
    places)."""
    used = responses.any(axis=1)
    return int(used.sum()), len(np.unique(responses[used].argmax(axis=1)))


def remeasured(model: Model, pool: Pool) -> Model:
    """``model`` with its network's responses to the references, as training measures them, and no calibration.

    Raises:
        ConfigError: the model is the float conductance model.
    """
    network = integer_model(model, "responses").network
    responses = reference_responses(network, model.activity, model.places, model.config, pool)
    used, covered = coverage(responses)
    figures = {
        "spikes_per_image": float(responses.sum() / len(model.labels)),
        "neurons_used": used,
        "places_covered": covered,
    }
    return replace(model, responses=responses, training={**model.training, **figures}, calibration=None)
