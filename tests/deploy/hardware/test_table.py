"""The table of hardware: complete, each belief with a source or marked unproven, docs/hardware.md, and what rows cite:
listed files whose headers are clean, and the script that says so."""

from __future__ import annotations

import ast
import hashlib
import re
import sys
from pathlib import Path

import pytest
from support.common import children

from lava_vpr import loihi
from lava_vpr.deploy.boards.constants import HOST_POWER, LOIHI_1
from lava_vpr.deploy.hardware.belief import Given, HardwareBelief, Span
from lava_vpr.deploy.hardware.table import ASSUMED, BELIEFS, kind_of, refusal, unproven_values
from scripts import cited_files as cited

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


def test_every_cited_file_is_listed_and_every_listed_file_is_cited() -> None:
    done = children.run([sys.executable, "scripts/cited_files.py"], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")
    everything = " ".join(row.evidence for row in BELIEFS.values())
    assert [file.path for file in cited.listed() if Path(file.path).name not in everything] == []


def test_every_listed_file_is_of_a_revision_and_clean() -> None:
    files = cited.listed()
    assert len({(file.repository, file.path) for file in files}) == len(files) > 30
    for file in files:
        assert re.fullmatch(r"[0-9a-f]{40}|PyPI \S+ \S+", file.revision), file
        assert re.fullmatch("[0-9a-f]{64}", file.sha256), file
        assert (file.clean, bool(file.seen)) == ("yes", True), file


NENGO = "nengo-loihi 1.1.0 (tag v1.1.0), "
MODELS = "intel-nrc-ecosystem/models at 3dc53bf, "


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (f"{NENGO}nengo_loihi/block.py:8; hardware/builder.py:3 (as a register)", None),
        (f"{MODELS}nxsdk_modules_contrib/pelenet/pelenet/snips/reset.c:31-48", None),
        ("lava-nc issue #322, and doi 10.1109/MM.2018.112130359", None),
        (f"{NENGO}nengo_loihi/other.py:8", "nengo_loihi/other.py: 0 listed files end so"),
        (f"{NENGO}nengo_loihi/block.py:8; slayer.c:80", "slayer.c: 0 listed files end so"),
        (f"{NENGO}validate.py:8", "validate.py: 2 listed files end so"),
        (f"{MODELS}nengo_loihi/block.py:8", "nengo_loihi/block.py: 0 listed files end so"),
        ("somebody's/repository, block.py:8", "block.py: no listed repository is named before it"),
    ],
)
def test_a_file_that_is_not_listed_is_found(text: str, fault: str | None) -> None:
    found = list(cited.faults(text, cited.listed()))
    assert len(found) == (fault is not None)
    assert not found or found[0].endswith(fault)


def test_a_listed_file_with_a_closed_header_is_found() -> None:
    files = [file._replace(clean="no") for file in cited.listed()]
    assert "its header is not clean" in next(cited.faults(f"{NENGO}nengo_loihi/block.py:8", files))


def test_no_tracked_file_names_another_file_of_that_repository() -> None:
    """Beside the table, programs and documents cite, too."""
    listed = {file.path for file in cited.listed()}
    paths = [path for kind in ("*.py", "*.c", "*.md") for path in ROOT.glob(f"[a-z]*/**/{kind}")]
    texts = [path.read_text(encoding="utf-8") for path in paths]
    named = {name for text in texts for name in re.findall(r"nxsdk_modules_\w+/[\w./-]+\.\w+", text)}
    assert len(texts) > 600
    assert named - listed == set()


def test_header_and_hash_of_listed_files_are_checked(tmp_path: Path) -> None:
    file = next(file for file in cited.listed() if file.repository == "nengo/nengo-loihi")
    sound = b"# free\n" * 99
    sound_file = file._replace(sha256=hashlib.sha256(sound).hexdigest())
    assert cited.content(file, tmp_path) is None
    assert cited.verdict(file, None) == "not at hand"
    assert cited.verdict(sound_file, sound) == "ok"
    assert cited.verdict(file, sound) == "DIFFERS: another hash"
    for word in (b"Intel Corporation CONFIDENTIAL", b"you may not disclose"):
        assert cited.verdict(sound_file, b"\n" * 20 + word + b"\n" + sound) == "CLOSED: its header forbids reading"
    repository = tmp_path / "nengo" / "nengo-loihi"
    repository.mkdir(parents=True)
    (repository / "block.py").write_bytes(sound)
    git = ["git", "-c", "user.name=nobody", "-c", "user.email=nobody", "-c", "commit.gpgsign=false"]
    for words in (["init", "--quiet"], ["add", "."], ["commit", "--quiet", "--message", "one"]):
        children.run([*git, *words], cwd=repository, check=True, capture_output=True)
    assert cited.content(file._replace(path="block.py", revision="HEAD"), tmp_path) == sound
    assert cited.content(file, tmp_path) is None
