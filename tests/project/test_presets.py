"""The presets are those of docs/network.md, number for number: a default that moves, moves there, too."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lava_vpr.config import PRESETS, Config, LifNetwork, StdpLearning, preset
from lava_vpr.engine.learning.integer import phases

PAGE = Path(__file__).resolve().parents[2] / "docs" / "network.md"
INTEGER = tuple(name for name in PRESETS if name != "paper")


def table(first: str) -> list[list[str]]:
    """The rows of the table of the page whose head begins with ``first``, cell by cell, the head included."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(first))
    rows = []
    for line in lines[start:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return [rows[0], *rows[2:]]


def written(config: Config, names: list[str]) -> str:
    """Settings as the page writes them; a name without a section is of the same as that before it."""
    section, words = "", []
    for name in names:
        section, _, key = name.rpartition(".") if "." in name else (section, "", name)
        value = getattr(getattr(config, section), key)
        words.append(str(value).lower() if isinstance(value, (bool, str)) else f"{value:g}")
    return ", ".join(words)


@pytest.mark.parametrize("name", INTEGER)
def test_a_preset_is_what_the_page_says(name: str) -> None:
    head, *rows = table("| | `loihi` |")
    column = head.index(f"`{name}`")
    told = {}
    for row in rows:
        names = re.findall(r"`([a-z_.]+)`", row[0])
        value = re.sub(r"(\d)\.0$", r"\1", row[column])
        assert written(preset(name), names) == value, row[0]
        told.update({key.rpartition(".")[2]: value for key in names})
    assert {"steps", "query_inputs", "query_spikes", "weight_bits", "threshold", "inhibition", "tau_membrane"} <= set(
        told
    )
    # What the page does not name is the default's.
    own, default = preset(name).network, preset("loihi").network
    assert isinstance(own, LifNetwork)
    for key in LifNetwork.__dataclass_fields__.keys() - told.keys():
        assert getattr(own, key) == getattr(default, key), key
    assert preset(name).learning == preset("loihi").learning


def test_every_integer_preset_stands_on_the_page() -> None:
    assert table("| | `loihi` |")[0] == ["", *(f"`{name}`" for name in INTEGER)]


def test_learning_is_what_the_page_says() -> None:
    head, competition, consolidation = table("| | epochs | eta |")
    assert head[1:] == ["epochs", "eta", "tau of the trace", "x_target", "threshold"]
    learning = preset("loihi").learning
    assert isinstance(learning, StdpLearning)
    first = [learning.competition_epochs, learning.eta, learning.tau_trace, learning.x_target]
    second = [learning.epochs - learning.competition_epochs, learning.consolidation_eta]
    second += [learning.consolidation_tau_trace, learning.consolidation_x_target]
    assert competition[1:5] == [f"{value:g}" for value in first]
    assert consolidation[1:5] == [f"{value:g}" for value in second]
    assert competition[5] == f"{learning.threshold:g}, + {learning.theta_plus:g} for every spike"
    assert (consolidation[5], learning.consolidation_threshold) == ("halved once, then constant", 0.5)


def test_learning_in_integers_is_what_the_page_says() -> None:
    _, *rows = table("| | rule | trace |")
    config = preset("loihi")
    assert isinstance(config.learning, StdpLearning)
    both = phases(config.learning, config.encoder.inputs, config.encoder.train_spikes)
    for row, phase in zip(rows, both, strict=True):
        rule = " + ".join(
            f"{scale}*2^{exponent}*y0*(x1-{phase.rule.target})" for scale, exponent in phase.rule.products
        )
        assert row[1:] == [f"`{rule}`", f"tau {phase.rule.tau:g}", f"{phase.neurons.theta_plus}"]
