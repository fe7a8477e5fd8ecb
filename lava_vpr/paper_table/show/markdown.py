"""The table as a Markdown page."""

from __future__ import annotations

from lava_vpr.paper_table.printed import DOI
from lava_vpr.paper_table.run import PaperTable
from lava_vpr.paper_table.show.tables import RULES, tables


def markdown(table: PaperTable) -> str:
    """The whole page; equal results give equal text."""
    wanted = table.wanted
    shown = "as many epochs as each preset says" if wanted.epochs is None else f"{wanted.epochs} epochs"
    lines = [
        "# The paper's table",
        "",
        "<!-- Written by the command below. -->",
        "",
        f"What Hussaini, Milford and Fischer (RA-L 2022, [doi {DOI}](https://doi.org/{DOI})) print of recall at 100 % "
        "precision, mean over sections, beside what this package measures: VPRSNN's network as coded (preset `paper`) "
        "with the paper's four decoders, SAD, vectors of NetVLAD where they are given, and this package's own presets "
        f"and matchers on the same images. Seed {wanted.seed}, {shown}; ± is the sample standard deviation over "
        "sections.",
        "",
        RULES,
        "",
        "```sh",
        table.command,
        "```",
    ]
    for one in tables(table):
        lines += ["", f"## {one.title[0].upper()}{one.title[1:]}", ""]
        if one.notes:
            lines += [*one.notes, ""]
        lines.append(one.markdown())
    return "\n".join(lines) + "\n"
