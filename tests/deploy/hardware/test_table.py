"""The table of hardware: complete, each belief with a source or marked unproven, and docs/hardware.md."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from lava_vpr import loihi
from lava_vpr.deploy.boards.constants import HOST_POWER, LOIHI_1
from lava_vpr.deploy.hardware.belief import Given, HardwareBelief, Span
from lava_vpr.deploy.hardware.table import ASSUMED, BELIEFS, kind_of, refusal, unproven_values

ROOT = Path(__file__).resolve().parents[3]


def names_in(path: str) -> set[str]:
    """All names that a module uses as attributes of `loihi`."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    return {node.attr for node in nodes if isinstance(node.value, ast.Name) and node.value.id == "loihi"}


def test_the_page_is_found() -> None:
    assert "docs/hardware.md" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_every_constant_of_the_chip_has_its_row() -> None:
    """A number in `lava_vpr.loihi` is the value of a row, in a register's range, or a figure of the cost model."""
    held = {name for row in BELIEFS.values() for name in row.constants}
    held |= names_in("deploy/hardware/nxsdk_registers.py") | names_in("deploy/boards/constants.py")
    assert {name for name in vars(loihi) if name.isupper()} - held == set()


def test_every_figure_of_the_cost_model_has_its_row() -> None:
    figures = [row.name.partition(":")[0] for row in BELIEFS.values() if row.kind == "figure"]
    assert figures == [constant.name for constant in (*LOIHI_1.listed(), HOST_POWER)]
    assert {
        name for name in figures if not next(r for r in BELIEFS.values() if r.name.startswith(f"{name}:")).proven
    } == ASSUMED


def test_every_row_has_a_source_or_says_why_not() -> None:
    for row in BELIEFS.values():
        assert (row.source is None) != (row.why is None), row.name
        assert "unproven" not in (row.source or ""), row.name
    assert 10 < sum(not row.proven for row in BELIEFS.values()) < len(BELIEFS) / 5


def test_a_row_with_both_or_neither_is_refused() -> None:
    for given in ({}, {"source": "a paper", "why": "a guess"}):
        with pytest.raises(TypeError, match="a limit: give a source, or why it is believed without one"):
            HardwareBelief("a limit", "a chip", "limit", 1, None, "nothing", **given)


@pytest.mark.parametrize(
    ("value", "kind", "allowed", "refused"),
    [
        (Span(-2, 3), "register", (-2, 3), (-3, 4)),
        (7, "register", (7,), (6, 8)),
        (7, "limit", (0, 7), (-1, 8)),
        ((1, 2, 8), "register", (1, 8), (0, 7)),
    ],
)
def test_what_a_row_allows(value: object, kind: str, allowed: tuple[int, ...], refused: tuple[int, ...]) -> None:
    row = HardwareBelief("thing", "a chip", kind, value, None, "all", "a paper")  # type: ignore[arg-type]
    assert [row.refusal(number) for number in allowed] == [""] * len(allowed)
    for number in refused:
        assert f"thing {number} is " in row.refusal(number)
        assert "(a paper)" in row.refusal(number)


def test_a_text_cannot_be_compared() -> None:
    with pytest.raises(TypeError, match="no number can be compared with"):
        HardwareBelief("call", "a library", "call", Given("f(x)"), None, "all", "a paper").allows(1)


def test_values_that_no_source_shows_are_refused_unless_asked_for() -> None:
    kinds = {
        name: [kind_of(row) for row in unproven_values(f"synapseFmt.{name}")]
        for name in ("fanoutType", "idxBits", "wgtExp")
    }
    assert kinds == {"fanoutType": [], "idxBits": ["rows without indices"], "wgtExp": []}
    for sign in (2, 3):
        assert f"fanoutType {sign} is not 1" in refusal("synapseFmt.fanoutType", sign, ["rows without indices"])
    assert refusal("synapseFmt.fanoutType", loihi.FANOUT_MIXED) == ""
    dense = ("synapseFmt.idxBits", 0)
    assert "rows without indices is shown by no public source" in refusal(*dense)
    assert refusal(*dense, ["rows without indices"]) == ""
    assert refusal(*dense, ["another kind"]) != ""
    assert refusal("synapseFmt.idxBits", 1) == ""


def test_rows_that_a_public_program_does_not_show_as_a_whole_are_unproven() -> None:
    """Those whose source has the parts alone, or was a file with a confidential header."""
    unproven = {row.name for row in BELIEFS.values() if not row.proven}
    assert unproven > {
        "synapseFmt.compression (rows with indices, of discrete axons)",
        "synapseFmt.wgtBits (weights of fewer than 8 bits)",
        "Wgt with fewer bits: the upper ones",
        "channel.write of messages of several words",
        "cx_state, written",
        "cx_cfg, written",
        "power of a run",
    }
