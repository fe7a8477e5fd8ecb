"""The report's section on probability: reliability of the answers, and what each target precision keeps."""

from __future__ import annotations

from collections.abc import Mapping

from lava_vpr.matching.evaluation import Metrics
from lava_vpr.matching.probability import UNREACHED
from lava_vpr.matching.trust import Threshold, Trust
from lava_vpr.show.numbers import fraction, is_number
from lava_vpr.show.svg import THEME, canvas, gridded, themed, to_svg
from lava_vpr.show.templates import render, safe

_WAYS = {"single": ("each image alone", "c0", "o"), "filtered": ("filtered", "c3", "D")}
"""Title, colour and marker of each way of answering."""
_HEADS = ("", "target precision", "threshold", "accepted", "precision", "kept", "false accepts")
_FOLLOWED = {"filtered": "filtered", "forward_backward": "forward-backward"}


@themed()
def reliability(trust: Mapping[str, Trust], label: str) -> str:
    """A drawing of the share of right answers over their probability; larger dots stand for more answers."""
    figure = canvas(470, 385)
    axes = gridded(figure, (0.1, 0.11, 0.885, 0.865))
    axes.plot([0, 1], [0, 1], color=THEME["muted"], linewidth=1.0, linestyle=(0, (4, 3)), zorder=0)
    for name, found in trust.items():
        _, colour, marker = _WAYS[name]
        total = sum(bin_.answers for bin_ in found.bins)
        points = [(bin_.probability, bin_.right) for bin_ in found.bins]
        axes.plot(*zip(*points, strict=True), gid=name, color=THEME[colour], linewidth=1.4, zorder=2)
        for bin_ in found.bins:
            size = 3.0 + 9.0 * (bin_.answers / total) ** 0.5
            style = {"color": THEME[colour], "markersize": size, "markeredgewidth": 0}
            axes.plot(bin_.probability, bin_.right, marker, zorder=3, clip_on=False, **style)
    axes.set(xlim=(0, 1.012), ylim=(0, 1.03), xlabel="probability", ylabel="share of the answers that were right")
    return to_svg(figure, "reliability", label)


def _row(title: str, row: Threshold) -> str:
    least = fraction(row.probability, 3) if is_number(row.probability) else "none"
    cells = (fraction(row.target, 2), least, *(fraction(value, 3) for value in row[2:]))
    return f'<tr><th scope="row">{title}</th>{"".join(f"<td>{cell}</td>" for cell in cells)}</tr>'


def _followed(followed: Mapping[str, Metrics]) -> str:
    """Recall of the filter, in a sentence."""
    if not followed:
        return ""
    parts = (f"{_FOLLOWED[k]} {fraction(v.recall_at_1, 3)} (AUC {fraction(v.auc, 3)})" for k, v in followed.items())
    return f"R@1 of queries in driving order: {'; '.join(parts)}; filtered looks back, forward-backward also ahead."


def section(trust: Mapping[str, Trust], followed: Mapping[str, Metrics]) -> str:
    """The section; empty if no probabilities are known.

    Args:
        trust: How well probabilities agree with the truth, by way of answering.
        followed: Figures of a filter; empty if there was none.
    """
    if not trust:
        return ""
    errors = "; ".join(f"{_WAYS[name][0]} {100 * found.error:.1f} %" for name, found in trust.items())
    alt = f"Share of the answers that were right over their probability; expected calibration error: {errors}"
    legend = "".join(
        f'<li><svg viewBox="0 0 34 12" aria-hidden="true"><line x1="0" x2="34" y1="6" y2="6" '
        f'stroke="var(--{_WAYS[name][1]})" stroke-width="3"/></svg><span>{safe(_WAYS[name][0])}</span></li>'
        for name in trust
    )
    rows = "".join(
        _row(_WAYS[name][0] if number == 0 else "", row)
        for name, found in trust.items()
        for number, row in enumerate(found.thresholds)
    )
    one = next(iter(trust.values()))
    return render(
        "report_trust.html",
        off_map=f"{100 * one.off_map:.1f} % are" if one.off_map else "none is",
        taken=one.taken,
        errors=safe(errors),
        followed=safe(_followed(followed)),
        drawing=reliability(trust, safe(alt)),
        legend=legend,
        heads="".join(f'<th scope="col">{head}</th>' for head in _HEADS),
        rows=rows,
        unreached="" if any(is_number(row.probability) for row in one.thresholds) else f" {UNREACHED}",
    )
