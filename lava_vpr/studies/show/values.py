"""What a study found as JSON values, and as a table."""

from __future__ import annotations

from typing import Any

from lava_vpr.configfile import to_dict
from lava_vpr.experiments.spread import Spread
from lava_vpr.matching.figures import Recall, titles
from lava_vpr.show.numbers import NONE, figure, named, percent
from lava_vpr.show.table import Table
from lava_vpr.studies.measuring import BOARD, COSTED
from lava_vpr.studies.run import Row, Studied

SHARES = ("covered", "removed")
"""Facts that are shares, shown in percent; all others are counts."""


def as_json(found: Studied) -> dict[str, Any]:
    """The figures in the layout that scripts rely on: fractions in 0..1, None where nothing can be computed."""
    settings = {key: value for key, value in to_dict(found.config).items() if key != "seed"}
    return {
        "study": found.study.name,
        "varied": found.study.varied,
        "places": found.places,
        "queries": found.queries,
        "seeds": list(found.seeds),
        "board": BOARD.name,
        "settings": settings,
        "points": [_point(row) for row in found.rows],
    }


def _point(row: Row) -> dict[str, Any]:
    return {
        "point": row.point,
        "value": row.value,
        "network": {name: _spread(value) for name, value in row.network.items()},
        "baselines": {name: recall._asdict() for name, recall in row.baselines.items()},
        "modelled": None if row.costs is None else row.costs._asdict(),
        "facts": {name: _spread(value) for name, value in row.facts.items()},
    }


def _spread(value: Spread) -> dict[str, Any]:
    return {
        "mean": value.mean,
        "deviation": value.deviation,
        "by_seed": {str(seed): one for seed, one in value.by_seed.items()},
    }


def table(found: Studied) -> Table:
    """The table of a study: recall with its spread over seeds, then facts, baselines and modelled costs."""
    facts = tuple(dict.fromkeys(name for row in found.rows for name in row.facts))
    baselines = tuple(dict.fromkeys(name for row in found.rows for name in row.baselines))
    costed = any(row.costs is not None for row in found.rows)
    columns = [found.study.varied, *titles(), *map(named, facts), *baselines]
    lines = []
    for row in found.rows:
        cells = [row.point, *(_share(row.network[name]) for name in Recall._fields)]
        cells += [_fact(name, row.facts.get(name)) for name in facts]
        cells += [_three(row.baselines.get(name)) for name in baselines]
        if costed:
            cells += [figure(row.costs.microjoules), figure(row.costs.milliseconds)] if row.costs else [NONE, NONE]
        lines.append(tuple(cells))
    several = len(found.seeds) > 1
    note = f"Recall in percent, exact matches as the truth has them, mean of seeds {_listed(found.seeds)}"
    note += ", ± their standard deviation." if several else "."
    if baselines:
        note += f" Baselines: {' / '.join(titles())}."
    if costed:
        note += (
            f" Energy and time of a query: modelled for {BOARD.title}, nominal, dynamic, clearing included, host I/O "
            f"not; seed {found.seeds[0]}, first {COSTED} queries."
        )
    return Table(
        (*columns, *(("modelled uJ", "modelled ms") if costed else ())),
        lines,
        (note, found.study.note),
        f"{found.study.title.lower()}: {found.queries} queries, {found.places} places, preset {found.config.preset}",
    )


def _listed(seeds: tuple[int, ...]) -> str:
    return ", ".join(map(str, seeds))


def _share(value: Spread) -> str:
    """A fraction in percent, with its deviation."""
    return percent(value.mean) if value.deviation is None else f"{percent(value.mean)} ± {percent(value.deviation)}"


def _fact(name: str, value: Spread | None) -> str:
    if value is None:
        return NONE
    if name in SHARES:
        return percent(value.mean)
    return f"{int(value.mean):,}" if value.mean.is_integer() else figure(value.mean, 4)


def _three(value: Recall | None) -> str:
    return NONE if value is None else " / ".join(map(percent, value))
