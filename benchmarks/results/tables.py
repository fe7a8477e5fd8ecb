"""The rows of the results and the tables that show them, in docs/results.md and README; `make pages` writes these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from benchmarks.figures import markdown, read
from benchmarks.places import PlacesSection, sections_of
from benchmarks.results.rows import STANDING, TAU, Record, ResultRow
from lava_vpr.bench.show.tables import DYNAMIC, WHOLE, WITHOUT_ENCODING
from lava_vpr.config import PRESETS, preset
from lava_vpr.configfile import update

FIVE, TEN = sections_of("nordland", 500), sections_of("nordland_long", 1000)
SHORT, LONG = (PlacesSection("nordland_all", 0, 500),), (PlacesSection("nordland_all", 0, 1500),)
GARDENS = (PlacesSection("gardens", 50, 100),)
LATE = FIVE[2:]
"""Sections that the search for the settings did not see; the first two chose them."""
INTEGER = tuple(name for name in PRESETS if name != "paper")
DEFAULT = INTEGER[0]
PAPERS = ("standard", "weighted", "probability", "weighted_probability")
SIMPLER = {"template": "without learning", "cosine": "`cosine`", "hog": "HOG", "sad": "SAD"}
SIMPLEST = tuple(SIMPLER)
POISSON = {"network": {"trains": "poisson", "input_mode": "injected"}}
ALL_INPUTS = {"encoder": {"query_inputs": 0}}
VIEWS: Mapping[str, dict[str, Any]] = {
    "one": {},
    "three (`--views 3`)": {"shifts": 3},
    "five in three scales (`[views]`)": {"shifts": 5, "shift": 0.071, "scales": 3},
}


def _learned(name: str) -> ResultRow:
    """A preset on the five sections, with everything that the default one is compared with."""
    default = name == DEFAULT
    matchers = SIMPLEST + (PAPERS if default else ())
    return ResultRow(f"{name}, five sections", preset(name), FIVE, matchers, adapt=default, costs=True)


LEARNED = {name: _learned(name) for name in INTEGER}
DRAWN = {
    name: ResultRow(f"{name}, five sections, Poisson trains in queries", update(preset(name), POISSON), FIVE)
    for name in INTEGER
}
LENGTHS = {
    "500": ResultRow("500 places", preset(DEFAULT), SHORT, SIMPLEST, costs=True),
    "500, in sequences of 5": ResultRow("500 places, sequences of 5", preset(DEFAULT), SHORT, SIMPLEST, sequence=5),
    "1,500": ResultRow("1,500 places", preset(DEFAULT), LONG, SIMPLEST, costs=True),
    "1,500, all inputs spike in queries": ResultRow(
        "1,500 places, all inputs", update(preset(DEFAULT), ALL_INPUTS), LONG, SIMPLEST, costs=True
    ),
}
FURTHER = ResultRow("ten further sections", preset(DEFAULT), TEN, SIMPLEST, adapt=True)
STILL = ResultRow(
    f"five sections, each image {STANDING} times with noise",
    preset(DEFAULT),
    FIVE,
    ("template", "cosine"),
    adapt=True,
    standing=True,
)
ADAPTED = {
    "the five sections": LEARNED[DEFAULT],
    "ten further sections, which the search did not see": FURTHER,
    f"the five sections, standing still for {STANDING} frames at every place": STILL,
}
WALKED = {
    title: ResultRow(f"Gardens Point, views: {title}", update(preset(DEFAULT), {"views": views}), GARDENS, SIMPLEST, 2)
    for title, views in VIEWS.items()
}
RIDDEN = {
    title: ResultRow(f"five sections, views: {title}", update(preset(DEFAULT), {"views": views}), FIVE)
    for title, views in VIEWS.items()
    if views
}
TIMED = ("loihi", "balanced", "fast")
"""The presets of which a whole query has been timed."""
ENERGY_OF = {name: LEARNED[name] for name in TIMED} | {
    "500 places": LENGTHS["500"],
    "1,500 places": LENGTHS["1,500"],
    "1,500 places, all inputs": LENGTHS["1,500, all inputs spike in queries"],
    "Gardens Point, five views in three scales": list(WALKED.values())[-1],
}
"""The rows whose energy is known, by what the record ``energy`` calls them."""
ENERGY = (WHOLE, WITHOUT_ENCODING, DYNAMIC)
HEADS = tuple(f"{name}, µJ" for name in ENERGY)
"""Costs that are printed with recall: never the chip's dynamic energy without the rest."""
KINDS: Mapping[str, Sequence[ResultRow]] = {
    "sections": (*LEARNED.values(), *DRAWN.values()),
    "long": tuple(LENGTHS.values()),
    "adapted": (FURTHER, STILL),
    "views": (*WALKED.values(), *RIDDEN.values()),
}
"""The rows by the table that shows them."""
ROWS = tuple(row for rows in KINDS.values() for row in rows)


def energies(way: str, names: Sequence[str] = ENERGY) -> list[str]:
    """Energies of a query by ``CASE, WAY`` of the record ``energy``."""
    known = read("energy")
    (row,) = (dict(zip(known.columns, row, strict=True)) for row in known.rows if row[0] == way)
    return [row[name].replace("-", "") for name in names]


def of_row(row: ResultRow, way: str = "Kapoho Bay", names: Sequence[str] = ENERGY) -> list[str]:
    """Energies of a query to a row of results; empty where they are not known."""
    case = next((case for case, known in ENERGY_OF.items() if known is row), None)
    return [""] * len(names) if case is None else energies(f"{case}, {way}", names)


def strong(cell: str) -> str:
    """A cell with its means emphasised, not what is in brackets."""
    mean, bracket, rest = cell.partition(" (")
    return f"**{mean}**{bracket}{rest}"


def simpler(record: Record, row: ResultRow, suffix: str = "") -> list[str]:
    """The cells of a row: its network, then what is simpler; empty where that was not computed."""
    others = (record.cell(row, name + suffix) if name in row.matchers else "" for name in SIMPLER)
    return [strong(record.cell(row, f"network{suffix}")), *others]


def _sections(record: Record) -> str:
    """Five sections of 100 Nordland places by every preset, the seeds, and the paper's decoders."""
    head = ["", "as learned", "places 200:500, which the search did not see", "without learning", "Poisson trains"]
    rows = []
    for name, row in LEARNED.items():
        cells = [strong(record.cell(row)), record.cell(row, sections=LATE), record.cell(row, "template")]
        cells += [record.cell(DRAWN[name]), record.cell(row, "cosine"), *of_row(row)]
        cells.append(f"{record.mean(row, 'costs')[1]:.2f}")
        rows.append([f"preset `{name}`", *cells])
    default = LEARNED[DEFAULT]
    for rival in ("cosine", "hog", "sad"):
        cells = [record.cell(default, rival), record.cell(default, rival, LATE), "", "", ""]
        rows.append([f"{SIMPLER[rival]} instead of a network", *cells, *of_row(default, SIMPLER[rival]), ""])
    papers = ", ".join(f"{name.replace('_', ' ')} {record.cell(default, name)}" for name in PAPERS)
    table = markdown([*head, "`cosine`", *HEADS, "time on the chip, ms, modelled"], rows)
    return f"{table}\n\nThe paper's decoders on the same spikes as `{DEFAULT}`: {papers}."


def _long(record: Record) -> str:
    """Long maps: 500 and 1,500 Nordland places in one model of the default preset."""
    rows = []
    for title, row in LENGTHS.items():
        rows.append([title, *simpler(record, row), *of_row(row), *of_row(row, "`cosine`", ENERGY[1:2])])
    return markdown(["places in one model", "as learned", *SIMPLER.values(), *HEADS, f"`cosine`: {HEADS[1]}"], rows)


def _adapted(record: Record) -> str:
    """Adaptation to the queries before: a line for each row, and below it the same adapted."""
    rows = []
    for title, row in ADAPTED.items():
        rows.append([title, *simpler(record, row)])
        rows.append([f"the same with `--adapt {TAU:g}`", *simpler(record, row, ", adapted")])
    return markdown(["", "as learned", *SIMPLER.values()], rows)


def _views(record: Record) -> str:
    """Gardens Point on the other side of the path, and what several views of a place cost Nordland."""
    costs = {title: record.cell(RIDDEN.get(title, LEARNED[DEFAULT])) for title in WALKED}
    rows = [[title, *simpler(record, row), costs[title]] for title, row in WALKED.items()]
    head = [
        "views of each place; 50 queries",
        "as learned",
        *SIMPLER.values(),
        "what it costs the five Nordland sections",
    ]
    return markdown(head, rows)


def _six(record: Record) -> str:
    """What a newcomer should know first: R@1 in percent, with what is simpler beside it, and energies."""
    titled = {
        "Nordland, five sections of 100 places": LEARNED[DEFAULT],
        "ten further sections, which no search saw": FURTHER,
        "500 places in one map": LENGTHS["500"],
        "1,500 places in one map": LENGTHS["1,500"],
        "Gardens Point, 50 places, from the other side": list(WALKED.values())[-1],
    }
    rows, known = [], [name for name in SIMPLER if name != "sad"]  # which hog is ahead of in each
    for title, row in titled.items():
        own, *rivals = (record.cell(row, name, figures=1) for name in ("network", *known))
        rows.append([title, strong(own), *rivals, *of_row(row)])
    return markdown(["", "recognised", *(SIMPLER[name] for name in known), *HEADS], rows)


def _conditions(_: Record) -> str:
    """What the energies depend on, and what computes them."""
    known = read("energy")
    return f"Energies, nominal (low to high): {known.conditions} (`{known.command}`)."


def _origin(record: Record) -> str:
    """Where the tables come from."""
    settings, sources = record.origin
    return (
        f"`make results` wrote these tables from [results.json](results.json): settings `{settings}`, "
        f"sources `{sources}`."
    )


_PARTS: Mapping[str, Callable[[Record], str]] = {
    **{"sections": _sections, "long": _long, "adapted": _adapted, "views": _views},
    **{"six": _six, "conditions": _conditions, "origin": _origin},
}
PARTS = {name: lambda part=part: part(Record.read()) for name, part in _PARTS.items()}  # type: ignore[misc]
