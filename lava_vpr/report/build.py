"""The data of both reports, from a model and its answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.rivals import BASELINES
from lava_vpr.configfile import to_toml
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.gains import Season
from lava_vpr.engine.inference import counting
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.engine.rates import query_rates16
from lava_vpr.inputs.encoder import INPUTS, Keep
from lava_vpr.matching.answers import Answers
from lava_vpr.model import Model, as_integer
from lava_vpr.positions.frames import joined
from lava_vpr.recognition import Recognition
from lava_vpr.report.answers import AnswersData
from lava_vpr.report.data import MapData, Raster, ReportData
from lava_vpr.report.layers import Layers
from lava_vpr.report.season import Trusted
from lava_vpr.traverse import Traverse
from lava_vpr.truth.alignment import NEAR_M, Located, PositionErrors

PICTURED = ("sad", "cosine")
"""Baselines whose score matrices are drawn beside the default decoder's; tables and curves show all baselines."""
RASTERS = 2
"""Rasters of right answers, at most, and of wrong ones."""


def report_data(
    model: Model,
    queries: EncodedTraverse,
    result: Recognition,
    command: str,
    sequence: int,
    seed: int | None,
    errors: PositionErrors | None = None,
) -> ReportData:
    """The data of the evaluation report.

    Args:
        model: The model that answered.
        queries: The encoded queries.
        result: The model's answers, compared with the truth.
        command: Command line that makes the report again.
        sequence: Queries of a sequence, which is shown by its first query and place; 1: no sequences.
        seed: The seed of the queries' noise; None: the model's.
        errors: Metres of error; None: positions are not known.
    """
    n, places = result.truth.shape
    config = model.config
    kind = INPUTS[config.encoder.kind]
    summary = {
        "places": str(model.places),
        "queries": str(len(queries)),
        "neurons": str(model.neurons),
        "weights": f"{model.weight_bits} bits" if model.weight_bits else "float",
        "steps": str(config.steps),
        "input": f"{config.encoder.inputs} ({kind.name})",
        "preset": config.preset,
        "seed": str(config.seed if seed is None else seed),
    }
    if sequence > 1:
        summary["sequences of"] = str(sequence)
    return ReportData(
        title="Visual place recognition",
        command=command,
        summary=summary,
        default_decoder=result.default,
        metrics=result.metrics,
        matrices={name: result.scores[name] for name in (result.default, *PICTURED) if name in result.scores},
        truth=result.truth,
        matches=result.matches,
        confidence=result.confidence,
        place_names=model.place_names[:places],
        query_names=queries.names[:n],
        place_thumbnails=model.thumbnails[:places],
        query_thumbnails=queries.kept(Keep.THUMBNAILS, "the report")[:n],
        input_layout=config.encoder.layout,
        drawing=kind.drawing,
        legend=kind.legend,
        weights=model.network.weights,
        neuron_places=np.where(model.neuron_places() < places, model.neuron_places(), -1),
        rasters=_rasters(model, queries, result, config.seed if seed is None else seed),
        events={name: value / max(1, len(queries)) for name, value in result.events.items()},
        config_toml=to_toml(config),
        seen={name: sees for name, sees in BASELINES.items() if name in result.metrics},
        place_numbers=tuple(int(k) for k in model.place_indices[:places]),
        query_numbers=tuple(int(k) for k in queries.indices[:n]),
        map=None if errors is None else map_of(errors.located, n, places, errors.in_words()),
        trust=result.trust,
        followed=result.followed,
        changed=result.changed,
        season=Trusted.of(model, result.season),
        layers=_layers(model, queries.names, queries.thumbnails, queries.grey, result.matches, result.confidence),
    )


def answers_data(
    model: Model,
    queries: Traverse,
    answers: Answers,
    accepted: NDArray[np.bool_],
    thumbnails: NDArray[np.uint8],
    least: float,
    command: str,
    summary: Mapping[str, str],
    season: Season | None = None,
    grey: NDArray[np.uint8] | None = None,
) -> AnswersData:
    """The data of the page of ``query``.

    Args:
        model: The model that answered.
        queries: The n queries.
        answers: The model's answers.
        accepted: Whether each answer is accepted, bool (n,).
        thumbnails: The queries, reduced, uint8 (n, h, w, 3) BGR.
        least, command, summary: As in `AnswersData`.
        season: The season after the last query; None if all inputs count alike.
        grey: The pixels as a spiking front end takes them, uint8 (n, *shape); None without one.
    """
    return AnswersData(
        command,
        summary,
        queries.names,
        queries.indices,
        thumbnails,
        model.place_names,
        model.place_indices,
        model.thumbnails,
        answers.matches,
        accepted,
        answers.probability,
        answers.confidence,
        least,
        answers.off_map,
        answers.followed,
        _answers_map(model, queries, answers),
        Trusted.of(model, season),
        _layers(model, queries.names, thumbnails, grey, answers.matches, answers.confidence),
    )


def _layers(
    model: Model,
    names: Sequence[str],
    thumbnails: NDArray[np.uint8] | None,
    grey: NDArray[np.uint8] | None,
    matches: NDArray[np.int64],
    confidence: NDArray[np.float64],
) -> Layers | None:
    """The spikes of the front end for the surest match; None without a front end, or if its pixels were not kept."""
    spec = model.config.encoder.front_end
    if spec is None or grey is None or thumbnails is None or not len(matches):
        return None
    surest = int(np.argmax(np.where(matches >= 0, np.nan_to_num(confidence), -np.inf)))
    return Layers.of(spec, thumbnails[surest], names[surest], grey[surest])


def _answers_map(model: Model, queries: Traverse, answers: Answers) -> MapData | None:
    """The map of places and queries, which stand at their matches if their positions are not known.

    None if the positions of the places are not known.
    """
    places, matches = model.whereabouts, answers.matches
    if places is None:
        return None
    if queries.positions is None:
        return map_of(Located(places, places.take(np.maximum(matches, 0))), len(matches), model.places, "")
    located = Located.of(places, queries.positions, queries.source)
    errors = PositionErrors(located, located.errors(matches), NEAR_M)
    return map_of(located, len(matches), model.places, errors.in_words())


def map_of(located: Located, queries: int, places: int, figures: str) -> MapData:
    """The map of the first ``queries`` and ``places``, in metres from the middle of all, with ``figures`` in words."""
    points = joined([located.places.take(slice(places)), located.queries.take(slice(queries))]).plane()
    points = points - (points.min(axis=0) + points.max(axis=0)) / 2  # eastings and northings are long numbers
    return MapData(points[:places], points[places:], figures)


def _chosen(result: Recognition) -> NDArray[np.int64]:
    """Indices of the surest right answers, then of the surest wrong ones, at most `RASTERS` of each, int64."""
    order = np.argsort(-result.confidence, kind="stable")
    matched = order[result.matches[order] >= 0]
    right = result.truth[matched, result.matches[matched]]
    return np.concatenate([matched[right][:RASTERS], matched[~right][:RASTERS]])


def _rasters(model: Model, queries: EncodedTraverse, result: Recognition, seed: int) -> tuple[Raster, ...]:
    """The spikes of a few queries, which are run again; empty for preset ``paper``, whose network records none."""
    integer = as_integer(model)
    if integer is None:
        return ()
    chosen = _chosen(result)
    rates = query_rates16(queries.activity[chosen], model.config.encoder)
    keys = presentation_keys(seed, "query", image_keys(rates))
    rasters = []
    for k, query in enumerate(chosen):
        counts, events, film = counting.count_spikes(integer.network, rates[k : k + 1], keys[k : k + 1], raster=True)
        if not np.array_equal(counts[0], result.counts[query]):
            continue  # a float backend counted other spikes, which this raster would not show
        steps, neurons = np.nonzero(film[0])
        true, place = np.flatnonzero(result.truth[query]), int(result.matches[query])
        rasters.append(
            Raster(
                query=int(query),
                place=place,
                true_place=int(true[np.abs(true - place).argmin()]) if len(true) else None,
                steps=film.shape[1],
                neurons=model.neurons,
                spike_steps=steps,
                spike_neurons=neurons,
                input_spikes=events["input_spikes"],
            )
        )
    return tuple(rasters)
