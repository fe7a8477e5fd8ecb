"""What rows of the table of hardware cite: listed files whose headers are clean, and the script that says so."""

from __future__ import annotations

import hashlib
import re
import sys
from pathlib import Path

import pytest
from support.common import children

from lava_vpr.deploy.hardware.table import BELIEFS
from scripts import cited_files as cited

ROOT = Path(__file__).resolve().parents[3]


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
