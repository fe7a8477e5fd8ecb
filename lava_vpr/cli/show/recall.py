"""Tables of a recognition on the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lava_vpr.backends.rivals import BASELINES
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.matching.evaluation import TITLES, Metrics, values_of
from lava_vpr.matching.probability import UNREACHED
from lava_vpr.model import Model
from lava_vpr.recognition import SINGLE, Recognition
from lava_vpr.show.numbers import percent
from lava_vpr.show.table import Table

MEANING = (
    "R@1: percent of the queries whose best match is a right place; R@N: one of the N best is.\n"
    "R@100P: percent recognised before the first wrong match, the surest first.\n"
    "AUC: how well confidence tells right matches from wrong ones, at best 100 (the area under precision over recall)."
)
"""The figures of `recall_table`, as lines to read before it."""


def in_words(result: Recognition, sequence: int = 1, seeds: int = 1) -> str:
    """How many queries were recognised, in a sentence; of several ``seeds``, with the first."""
    matches, what = result.matches, "queries" if sequence == 1 else f"sequences of {sequence} queries"
    right = np.count_nonzero((matches >= 0) & result.truth[np.arange(len(matches)), matches])
    first = f", with the first of {seeds} seeds" if seeds > 1 else ""
    return f"Recognised the place in {right} of {len(matches)} {what}{first}."


def recall_table(
    model: Model,
    result: Recognition,
    sequence: int = 1,
    again: Sequence[Recognition] = (),
    details: str = "--report, --table or --json",
) -> Table:
    """The figures of every matcher in percent, the default decoder first and marked.

    With the same queries recognised ``again`` with further seeds: means, least and most, of what these have. The last
    note says where the ``details`` are that a terminal leaves out.
    """
    what = "queries" if sequence == 1 else f"sequences of {sequence} queries"
    title = f"{len(result.matches)} {what}, {model.places} places, {model.neurons} neurons"
    notes = [
        "* the network, by the decoder that answers; the others see the same images:",
    ]
    notes += [f"{name} sees {BASELINES[name]}" for name in result.metrics if name in BASELINES]
    if result.followed:
        notes.append("filtered: queries in driving order, each with those before it; forward-backward: with all")
    notes += [_taught(name, *counted) for name, counted in result.taught.items() if counted[0]]
    if again:
        notes.append(f"{1 + len(again)} seeds of the queries' spikes: mean (least to most); all below is of the first")
    groups = _groups(result)
    several = [{name: one for group in groups for name, one in group.items()}]
    several += [{name: one for group in _groups(further) for name, one in group.items()} for further in again]
    rows = [(name, *_cells([one[name] for one in several if name in one])) for name in several[0]]
    rules = frozenset({len(groups[0]), len(groups[0]) + len(groups[1])})
    heads, aside = ("matcher", *TITLES.values()), frozenset(k for k, name in enumerate(several[0]) if name in DECODERS)
    columns = frozenset({2, 3, 5, 6} if again else {5, 6})
    notes.append(f"{', '.join(heads[k] for k in sorted(columns))} and the other decoders: {details}")
    return Table(heads, rows, notes, title, rules=rules, aside=aside, aside_columns=columns)


def _groups(result: Recognition) -> tuple[dict[str, Metrics], ...]:
    """The rows of the table of recall by their titles, in the groups that rules part, the default decoder first."""
    names = [result.default, *(name for name in result.metrics if name != result.default)]
    return (
        {name + (" *" if name == result.default else ""): result.metrics[name] for name in names},
        {f"{name}, {way}": metrics for (name, way), metrics in result.changed.items()},
        {name.replace("_", "-"): metrics for name, metrics in result.followed.items()},
    )


def _cells(metrics: Sequence[Metrics]) -> Iterator[str]:
    """The figures of a matcher in percent, of one seed or of several."""
    for values in zip(*map(values_of, metrics), strict=True):
        known = [value for value in values if value is not None]
        if len(known) < len(values):
            yield percent(None)
            continue
        mean, least, most = map(percent, (sum(known) / len(known), min(known), max(known)))
        yield mean if least == most else f"{mean} ({least} to {most})"


def _taught(name: str, answers: int, wrong: int) -> str:
    """How many answers taught."""
    return f"{'gains' if name == SINGLE else name}: {answers} answers taught, {wrong} of them wrong"


def trust_tables(result: Recognition) -> list[Table | str]:
    """What each target precision keeps, and how far probabilities are from what they say, where they are known."""
    if not result.trust:
        return []
    way, one = next(iter(result.trust.items()))
    unreached = not any(np.isfinite(row.probability) for row in one.thresholds)
    if unreached and len(result.trust) == 1:
        return [UNREACHED]
    off = f"{percent(one.off_map)} % of the queries are" if one.off_map else "no query is"
    notes = [
        "percent; accepted: of all queries; precision: of the accepted",
        *(["single: each query alone"] if SINGLE in result.trust else []),
        f"{off} off the map; probabilities assume {one.taken} (--off-map)",
    ]
    rows = []
    for name, found in result.trust.items():
        for number, row in enumerate(found.thresholds):
            least = f"{row.probability:.3f}" if np.isfinite(row.probability) else "none"
            figures = map(percent, (row.accepted, row.precision, row.kept, row.false_accepts))
            first = (name, percent(found.error)) if number == 0 else ("", "")
            rows.append((first[0], percent(row.target), least, *figures, first[1]))
    columns = ("", "target", "threshold", "accepted", "precision", "kept", "false accepts", "error")
    title = "accepted by --target-precision"
    table = Table(columns, rows, notes, title, aside_columns=frozenset({2, 5, 6, 7}))
    return [table, f"{way}: {UNREACHED}"] if unreached else [table]
