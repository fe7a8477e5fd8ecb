"""Five sections of 100 Nordland places by every preset of an integer network: the first table."""

from __future__ import annotations

from benchmarks.figures import markdown
from benchmarks.places import sections_of
from benchmarks.results.record import Record
from benchmarks.results.rows import SEEDS, Row
from lava_vpr.config import PRESETS, preset
from lava_vpr.configfile import update

FIVE = sections_of("nordland", 500)
CHOSE = 2
"""So many sections, the first ones, chose the settings."""
INTEGER = tuple(name for name in PRESETS if name != "paper")
DEFAULT = INTEGER[0]
PAPERS = ("standard", "weighted", "probability", "weighted_probability")
SIMPLER = ("template", "cosine", "hog", "sad")
POISSON = {"network": {"trains": "poisson", "input_mode": "injected"}}

LEARNED = {
    name: Row(
        f"{name}, five sections",
        preset(name),
        FIVE,
        SIMPLER + (PAPERS if name == DEFAULT else ()),
        adapt=name == DEFAULT,
        costs=True,
    )
    for name in INTEGER
}
DRAWN = {
    name: Row(f"{name}, five sections, Poisson trains in queries", update(preset(name), POISSON), FIVE)
    for name in INTEGER
}
ROWS = (*LEARNED.values(), *DRAWN.values())


def lines(record: Record) -> str:
    """The table, the seeds, and the paper's decoders."""
    head = ["", "as learned", "places 200:500, which the search did not see", "without learning", "Poisson trains"]
    rows = [[*head, "`cosine`", "µJ", "ms"]]
    late = FIVE[CHOSE:]
    for name in INTEGER:
        row = LEARNED[name]
        microjoules, milliseconds = record.mean(row, "costs")
        cells = [f"**{record.cell(row)}**", record.cell(row, sections=late), record.cell(row, "template")]
        cells += [record.cell(DRAWN[name]), record.cell(row, "cosine"), f"{microjoules:.2f}", f"{milliseconds:.2f}"]
        rows.append([f"preset `{name}`", *cells])
    default = LEARNED[DEFAULT]
    for rival, title in (("hog", "HOG"), ("sad", "SAD")):
        cells = [record.cell(default, rival), record.cell(default, rival, late)]
        rows.append([f"{title} instead of a network", *cells, "", "", "", "", ""])
    seeds = "; ".join(f"{record.mean(default, seeds=(seed,))[0]:.1f}" for seed in SEEDS)
    papers = ", ".join(f"{name.replace('_', ' ')} {record.cell(default, name)}" for name in PAPERS)
    numbers = "; ".join(map(str, SEEDS))
    sentence = f"R@1 of `{DEFAULT}` by seed ({numbers}): {seeds}. The paper's decoders on the same spikes: {papers}."
    return f"{markdown(rows[0], rows[1:])}\n\n{sentence}"
