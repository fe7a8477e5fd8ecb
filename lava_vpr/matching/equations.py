"""From spike counts to place scores: neuronal assignments and the equations of the decoders.

The functions see the responses S^R (int, (n_exc, n_places): spikes of each neuron on the reference images of each
place) and the spikes s of a query (int, (n_exc,)) and nothing else. A decoder's function computes the part that depends
on the responses once, and returns the function of queries' spikes. Source of the paper's four: Hussaini, Milford,
Fischer, RA-L 2022 (doi 10.1109/LRA.2022.3149030), equations (4) to (9), and its released code.

A decoder of that name is, everywhere, what the release of the paper computes: variant ``vprsnn2022``, the default.
``vprsnn`` is the later head of that code; it counts a neuron as involved in many places from gamma on, not above it.
``printed`` is this project's own reading of the equations as printed in the paper, for comparison: no figure of the
paper was made with it, and its probabilities separate right from wrong answers badly where each place has one neuron,
because the best score is then about one over the spikes of a query, whatever the match. How ``printed`` reads them:

* (4) ``N_i = argmax_l S^R[i, l]``; equal counts go to the lowest label; a neuron silent on all references gets none.
* (5) the score of l is the sum of s over M_l, the neurons assigned to l. (The released code takes their mean.)
* (6) omega_i, printed as ``card({i | N_i in M_l})``, is what the text says: the number of labels with a spike of i.
* (7) as printed. The sum that turns it into a label's score is not printed: all neurons count here. (The released code
  takes neurons with more than 0.1 of their spikes at l, and only labels that are some neuron's first.)
* (8) is printed over labels, where it would be 1 for every neuron that fires. The text sums over the neurons that
  learned l: ``sum_i S^R[i, l] 1[s_i > 0] / sum_i S^R[i, l]``.
* (9) is printed over neurons k at one label, which would turn a label's score into the inverse of its largest share.
  The text scales "for every query image ... across all output neurons": minimum, maximum and sum are taken over the
  query's whole array, neurons (and, if weighted, labels). (The released code: `probability`, on label scores.)

Sums of shares are exact: shares are rounded once to 2^-30, and integers below 2^53 add up in float64 without error, so
that a query's scores are the same bits in any batch and on any machine. (The probability decoders then add up a query's
scores in numpy's order, the same in any batch.)
"""

from __future__ import annotations

import typing
from collections.abc import Callable, Iterator
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError, InputError

Counts = NDArray[np.integer[Any]]
Scores = NDArray[np.float64]
ScoresOf = Callable[[Counts], Scores]
"""A function from spikes (n_queries, n_exc) to scores (n_queries, n_places)."""
Table = Any
"""Values of pairs of a neuron and a place, (neurons, places): an array, or scipy's sparse matrix of a long map."""
Variant = Literal["vprsnn2022", "vprsnn", "printed"]
VARIANTS: tuple[str, ...] = typing.get_args(Variant)
RELEASED: Variant = "vprsnn2022"
"""What the paper's decoders are unless another variant is asked for by name."""

SHARE_UNIT = 2.0**-30
# Shares are at most 2^30 units, so a query of this many spikes still adds up below 2^53.
MAX_QUERY_SPIKES = 1 << 23
_DENSE = 1 << 22  # pairs of neurons and places: fewer are kept in a table
QUERY_BLOCK = 1024  # queries at a time: bounds what is needed beside the scores themselves


def _check_counts(name: str, array: Counts) -> None:
    """Refuse an array that holds no spike counts."""
    if array.ndim != 2 or array.dtype.kind not in "iu":
        raise InputError(f"{name}: {array.dtype} of shape {array.shape}, must be whole numbers in two dimensions")
    if array.size and int(array.min()) < 0:
        raise InputError(f"{name}: holds a negative count, must be spike counts of at least 0")


def _check_responses(responses: Counts) -> None:
    """Refuse responses that are no spike counts, or none at all."""
    _check_counts("responses", responses)
    if responses.size == 0:
        raise InputError(f"responses: shape {responses.shape}; train on at least one image with at least one neuron")


def _check_spikes(spikes: Counts, n_exc: int) -> None:
    """Refuse queries that are no spike counts of ``n_exc`` neurons, or could not be added up exactly."""
    _check_counts("spikes", spikes)
    if spikes.shape[1] != n_exc:
        neurons = f"{spikes.shape[1]} neurons, but responses hold {n_exc}"
        raise InputError(f"spikes: counts of {neurons}; use one model for both")
    most = int(spikes.sum(axis=1, dtype=np.int64).max(initial=0))
    if most > MAX_QUERY_SPIKES:
        raise InputError(
            f"spikes: a query has {most:,} spikes, at most {MAX_QUERY_SPIKES:,}; use fewer steps or neurons"
        )


def check_variant(variant: str) -> None:
    """Refuse a variant that is not in `VARIANTS`."""
    if variant not in VARIANTS:
        raise ConfigError(f"decoder variant {variant!r} is unknown; choose from {', '.join(VARIANTS)}")


def _products(spikes: Counts, table: Table) -> Scores:
    """``spikes @ table``, shape (n_queries, n_places), for counts of the neurons that ``table`` has rows for."""
    _check_spikes(spikes, table.shape[0])
    scores = np.empty((len(spikes), table.shape[1]))
    for block in _blocks(len(spikes)):
        _product(spikes[block].astype(np.float64), table, scores[block])
    return scores


def _product(spikes: Scores, table: Table, out: Scores) -> None:
    """``spikes @ table`` into ``out``. Of whole numbers sums are exact in any order: both kinds give the same bits."""
    if isinstance(table, np.ndarray) and len(spikes) == 1:  # a robot's: for one row all threads of BLAS would wake
        active = np.flatnonzero(spikes[0])
        np.einsum("i,il->l", spikes[0, active], table[active], out=out[0])
    elif isinstance(table, np.ndarray):
        np.matmul(spikes, table, out=out)
    else:
        out[:] = (table.T @ spikes.T).T


class Pairs(NamedTuple):
    """The pairs of a neuron and a place in whose reference image it spikes, and how often it does, int64 (pairs,)."""

    neurons: NDArray[np.int64]
    places: NDArray[np.int64]
    spikes: NDArray[np.int64]


def _pairs(responses: Counts) -> Pairs:
    """All of them, neuron after neuron."""
    neurons, places = (index.astype(np.int64) for index in responses.nonzero())
    return Pairs(neurons, places, responses[neurons, places].astype(np.int64))


def _table(pairs: Pairs, values: Scores, shape: tuple[int, ...]) -> Table:
    """``values`` of ``pairs`` in a table (neurons, places), 0 elsewhere; of long maps only the pairs are kept."""
    if shape[0] * shape[1] > _DENSE and len(values) * 8 < shape[0] * shape[1]:
        from scipy import sparse  # long maps alone wait for it

        return sparse.csc_matrix((values, (pairs.neurons, pairs.places)), shape=shape)
    table = np.zeros(shape)
    table[pairs.neurons, pairs.places] = values
    return table


def _blocks(n: int) -> Iterator[slice]:
    return (slice(start, min(n, start + QUERY_BLOCK)) for start in range(0, n, QUERY_BLOCK))


def _shares(responses: Counts, pairs: Pairs) -> Scores:
    """``S^R[i, l] / sum_m S^R[i, m]`` of every pair (i, l)."""
    return np.asarray(pairs.spikes / responses.sum(axis=1, dtype=np.int64)[pairs.neurons])


def _in_units(values: Scores) -> Scores:
    """``values`` in [0, 1] as whole numbers of `SHARE_UNIT`."""
    return np.rint(values * (1.0 / SHARE_UNIT))


def assign(responses: Counts) -> NDArray[np.int64]:
    """The label N_i of each neuron, equation (4).

    Args:
        responses: S^R, int (n_exc, n_places).
    Returns:
        int64 (n_exc,): the place with most spikes; equal counts: the lowest; -1 for a neuron silent on all references.
    """
    return first_most(responses)


def first_most(table: NDArray[Any]) -> NDArray[np.int64]:
    """Column of each row's largest value, the lowest of equal ones; -1 where all are 0."""
    return np.where(table.any(axis=1), table.argmax(axis=1), -1).astype(np.int64)


def _members(labels: NDArray[np.int64], n_places: int) -> tuple[Table, NDArray[np.int64]]:
    """M_l as a table (n_exc, n_places), 1 where neuron i is assigned to l; and their sizes, int64 (n_places,)."""
    known = np.flatnonzero((labels >= 0) & (labels < n_places))
    pairs = Pairs(known, labels[known].astype(np.int64), np.ones(len(known), np.int64))
    sizes = np.bincount(pairs.places, minlength=n_places)
    return _table(pairs, np.ones(len(known)), (len(labels), n_places)), sizes


def standard(responses: Counts, *, variant: Variant = RELEASED) -> ScoresOf:
    """Standard assignments, equation (5): spikes of the neurons assigned to a place.

    Args:
        responses: S^R, int (n_exc, n_places).
        variant: The released code takes the mean over M_l (0 where it is empty), ``printed`` sums.
    """
    _check_responses(responses)
    check_variant(variant)
    members, sizes = _members(assign(responses), responses.shape[1])
    if variant == "printed":
        return lambda spikes: _products(spikes, members)
    divisors = np.maximum(sizes, 1).astype(np.float64)
    return lambda spikes: _products(spikes, members) / divisors


def _weighted_table(
    responses: Counts, gamma: float, involvement: bool, strength: bool, variant: str
) -> tuple[Table, Pairs]:
    """What one spike of neuron i is worth at place l before the penalty, in `SHARE_UNIT`; and which i learned l."""
    n_places, pairs = responses.shape[1], _pairs(responses)
    if variant != "printed":
        totals = responses.sum(axis=1, dtype=np.int64)
        learned = pairs.spikes * 10 > totals[pairs.neurons]
        pairs = Pairs(*(part[learned] for part in pairs))
    values = _shares(responses, pairs) if strength else np.ones(len(pairs.spikes))
    if involvement:
        omega = np.count_nonzero(responses, axis=1)
        limit = gamma * n_places
        many = omega >= limit if variant == "vprsnn" else omega > limit
        values = values / np.where(many, np.maximum(omega, 1), 1)[pairs.neurons]
    return _table(pairs, _in_units(values), responses.shape), pairs


def weighted(
    responses: Counts,
    *,
    gamma: float = 0.02,
    involvement: bool = True,
    strength: bool = True,
    penalty: bool = True,
    variant: Variant = RELEASED,
) -> ScoresOf:
    """Weighted assignments, equations (6) to (8), summed over the neurons; scores are at least 0.

    Args:
        responses: S^R, int (n_exc, n_places).
        gamma: Share of the places above which a neuron counts as involved in many.
        involvement: Equation (6): spikes divided by omega_i if omega_i > gamma n_places (``vprsnn``: >=).
        strength: Equation (7): times the share of the neuron's spikes that place l got.
        penalty: Equation (8): times the share of l's spikes that came from neurons which fire at the query, too.
        variant: The released code counts, at l, neurons with more than 0.1 of their spikes there, and scores only
            places that are some neuron's label; ``printed`` counts all neurons, at all places.
    """
    _check_responses(responses)
    check_variant(variant)
    table, learned = _weighted_table(responses, gamma, involvement, strength, variant)
    scores_of = _weighted_by(table, _penalties(learned, responses.shape) if penalty else None)
    if variant == "printed":
        return scores_of
    _, sizes = _members(assign(responses), responses.shape[1])
    scored = sizes > 0
    return lambda spikes: np.where(scored, scores_of(spikes), 0.0)


def _weighted_by(table: Table, penalties: ScoresOf | None) -> ScoresOf:
    """Scores of spikes that are worth what ``table`` says in `SHARE_UNIT`, times ``penalties``, if there are any."""

    def scores_of(spikes: Counts) -> Scores:
        scores = _products(spikes, table)
        scores *= SHARE_UNIT
        if penalties is not None:
            for block in _blocks(len(spikes)):
                scores[block] *= penalties(spikes[block])
        return scores

    return scores_of


def _penalties(learned: Pairs, shape: tuple[int, ...]) -> ScoresOf:
    """The factor of equation (8), shape (n_queries, n_places); 0 for a place that no neuron learned."""
    totals = np.bincount(learned.places, weights=learned.spikes, minlength=shape[1])
    known = _table(learned, learned.spikes.astype(np.float64), shape)

    def penalties_of(spikes: Counts) -> Scores:
        heard = np.empty((len(spikes), shape[1]))
        _product((spikes > 0).astype(np.float64), known, heard)
        return np.divide(heard, totals, out=np.zeros(heard.shape), where=totals > 0)

    return penalties_of


def contrast(responses: Counts) -> ScoresOf:
    """The default decoder: each spike is shared among the places in proportion to its neuron's reference spikes.

    ``score[l] = sum_i s_i S^R[i, l] / sum_m S^R[i, m]``, equation (7) alone; a neuron silent on all references counts
    nothing. Its confidence (`decoders.contrast`) is the contrast of best and second. Scores are at least 0, in spikes.

    Args:
        responses: S^R, int (n_exc, n_places).
    """
    _check_responses(responses)
    pairs = _pairs(responses)
    return _weighted_by(_table(pairs, _in_units(_shares(responses, pairs)), responses.shape), None)


def probability(scores: Scores) -> Scores:
    """Label scores as probabilities, as the released code has them: n = (S - min S) / (max S - min S), P = n / sum n.

    Args:
        scores: Scores (n_queries, n_places).
    Returns:
        Scores of the same shape; each row sums to 1, or is all 0 where all scores of a query are equal.
    """
    n = np.ascontiguousarray(scores - scores.min(axis=1, keepdims=True), dtype=np.float64)
    highest = n.max(axis=1, keepdims=True)
    np.divide(n, highest, out=n, where=highest > 0)
    total = n.sum(axis=1, keepdims=True)
    return np.divide(n, total, out=n, where=total > 0)


def _rows(table: Table, chosen: NDArray[np.int64]) -> Scores:
    """Some rows of a table, in full."""
    return table[chosen] if isinstance(table, np.ndarray) else np.asarray(table[chosen].todense())


def _scaled(scores: Scores, size: NDArray[Any] | int, low: Scores, high: Scores, total: Scores) -> Scores:
    """Equation (9) summed over ``size`` neurons: ``(scores - size low) / ((high - low) total)``; no spread: all 0."""
    spread = ((high - low) * total)[:, None]
    above = np.maximum(scores - size * low[:, None], 0.0)  # rounding could leave a hair below 0
    return np.divide(above, spread, out=np.zeros_like(scores), where=spread > 0)


def standard_probability(responses: Counts) -> ScoresOf:
    """Equation (9) after (5), ``printed``: neurons scaled by the least, the most and all spikes at the query."""
    unscaled = standard(responses, variant="printed")
    _, size = _members(assign(responses), responses.shape[1])

    def scores_of(spikes: Counts) -> Scores:
        scores = unscaled(spikes)
        low, high, total = (of(axis=1).astype(np.float64) for of in (spikes.min, spikes.max, spikes.sum))
        return _scaled(scores, size, low, high, total)

    return scores_of


def weighted_probability(responses: Counts, gamma: float = 0.02) -> ScoresOf:
    """Equation (9) after (8), ``printed``: neuron-label pairs scaled by least, most and sum of the query's pairs."""
    _check_responses(responses)
    table, learned = _weighted_table(responses, gamma, True, True, "printed")
    penalties = _penalties(learned, responses.shape)
    unscaled = _weighted_by(table, penalties)

    def scores_of(spikes: Counts) -> Scores:
        scores = unscaled(spikes)
        low, high = np.zeros(len(spikes)), np.zeros(len(spikes))
        for block in _blocks(len(spikes)):
            for q, penalty in enumerate(penalties(spikes[block]) * SHARE_UNIT, start=block.start):
                active = np.flatnonzero(spikes[q])
                if len(active) == 0:
                    continue
                pairs = _rows(table, active) * spikes[q, active, None]
                high[q] = (pairs.max(axis=0) * penalty).max()
                if len(active) == spikes.shape[1]:  # else a silent neuron makes the least 0
                    low[q] = (pairs.min(axis=0) * penalty).min()
        return _scaled(scores, len(responses), low, high, scores.sum(axis=1))

    return scores_of
