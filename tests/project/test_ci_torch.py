"""What `make ci-torch` writes: steps judged by their end, a log of one form, and the one that is committed."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest
from support.common import children

from scripts import ci_torch as ci

ROOT = Path(__file__).resolve().parents[2]
PINS = (ROOT / "benchmarks" / "exchange" / "requirements.txt").read_text(encoding="utf-8")
HEAD = ("result", "date", "commit", "sources", "python", "packages", "images", "total")
HERE = "dca478b3300c2d7e"
"""Of the one source of the small tree."""
STEP = re.compile(r"^\d+\. (.+): (passed|failed)(?: \((.+)\))?, (\d+) s\n\$ python (.+)$", re.MULTILINE)


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small tree under git, with one commit, which the script takes for the project's."""
    folder = tmp_path / "tree"
    folder.mkdir()
    (folder / "a.py").write_text("print('here')\n")
    nobody = {f"GIT_{who}_{what}": "nobody" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
    for words in (["init", "--quiet"], ["add", "a.py"], ["commit", "--quiet", "--message", "one"]):
        children.run(["git", *words], cwd=folder, env=os.environ | nobody, check=True, capture_output=True)
    monkeypatch.setattr(ci, "ROOT", folder)
    monkeypatch.setattr(ci, "SOURCES", ("a.py",))
    monkeypatch.delenv(ci.IMAGES, raising=False)
    return folder


def head(text: str) -> dict[str, str]:
    """The head of a log by name, in order."""
    lines = text.partition("\n\n")[0].splitlines()
    return {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}


def says(*lines: str) -> tuple[str, ...]:
    return ("-c", f"for line in {lines!r}: print(line)")


def told(tree: Path, *steps: Any) -> tuple[int, str]:
    """The exit code and the log of some steps."""
    code = ci.main(["--log", str(tree / "logs" / "x.log")], steps, lambda line: None)
    assert sorted(path.name for path in (tree / "logs").iterdir()) == ["x.log"]
    return code, (tree / "logs" / "x.log").read_text(encoding="utf-8")


def test_a_log_says_when_on_what_and_how_each_step_ended(tree: Path) -> None:
    steps = [ci.Step("counts", says("1", "2", "3"), lines=2), ci.Step("is there", ("a.py",))]
    code, text = told(tree, *steps)
    assert code == 0
    assert tuple(head(text)) == HEAD
    commit = children.run(["git", "rev-parse", "HEAD"], cwd=tree, capture_output=True, text=True, check=True)
    assert head(text)["commit"] == f"{commit.stdout.strip()} (clean)"
    assert head(text)["sources"] == HERE
    assert head(text)["result"] == "passed"
    assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC", head(text)["date"])
    assert f"numpy {ci.versions()['numpy']}" in head(text)["packages"]
    assert [found[:3] for found in STEP.findall(text)] == [("counts", "passed", ""), ("is there", "passed", "")]
    assert re.search(r"^\$ python -c .*\n2\n3\n\n2\. ", text, re.MULTILINE)
    assert text.endswith("$ python a.py\nhere\n")
    # The log of before is no change of the tree.
    assert head(told(tree, *steps)[1])["commit"] == head(text)["commit"]


def test_a_step_that_fails_is_told_and_the_others_still_run(tree: Path) -> None:
    steps = (
        ci.Step("broken", ("-c", "raise SystemExit('no such thing')")),
        ci.Step("slow", ("-c", "import time; time.sleep(60)"), seconds=0.2),
        ci.Step("well", says("all equal")),
    )
    code, text = told(tree, *steps)
    assert code == 1
    assert head(text)["result"] == "2 of 3 steps failed"
    results = [found[1:3] for found in STEP.findall(text)]
    assert results == [("failed", "exit code 1"), ("failed", "took more than 0 s"), ("passed", "")]
    assert "\nno such thing\n" in text
    assert text.endswith("\nall equal\n")


def test_a_tree_with_changes_says_so(tree: Path) -> None:
    (tree / "a.py").write_text("print('there')\n")
    assert "(with changes that are not committed)" in head(told(tree, ci.Step("a", ("a.py",)))[1])["commit"]
    changes = ("-c", "import pathlib; pathlib.Path('b.py').write_text('')")
    children.run(["git", "checkout", "--quiet", "a.py"], cwd=tree, check=True)
    assert head(told(tree, ci.Step("b", changes))[1])["commit"].endswith("(clean; it changed under way)")


def test_a_log_elsewhere_and_a_tree_without_git(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = tree.parent / "x.log"
    step = ci.Step("a", ("a.py",))
    assert ci.main(["--log", str(log)], [step], lambda line: None) == 0
    assert head(log.read_text(encoding="utf-8"))["commit"].endswith(" (clean)")
    (tree / ".git").rename(tree / "git")
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tree.parent))
    assert ci.main(["--log", str(log)], [step], lambda line: None) == 0
    found = head(log.read_text(encoding="utf-8"))
    assert found["commit"] == "unknown (with changes that are not committed)"
    assert found["sources"] == "unknown"


def test_whether_a_log_is_of_the_sources_as_they_are(tree: Path) -> None:
    log, said = tree / "logs" / "x.log", []

    def since() -> str:
        assert ci.main(["--since", "--log", str(log)], [ci.Step("none", ("b.py",))], said.append) == 0
        return str(said[-1]).partition(f", sources {HERE}, ")[2]

    _, text = told(tree, ci.Step("a", ("a.py",)))
    assert since() == "as they are today"
    log.write_text(text.replace("commit:   ", "commit:   e"), encoding="utf-8")  # a commit that git does not have
    assert since() == "those of HEAD"
    (tree / "a.py").write_text("print('there')\n")
    assert since() == "those of HEAD"
    log.write_text(text, encoding="utf-8")
    assert since() == "since changed: a.py"
    log.write_text("result:   passed\n", encoding="utf-8")
    with pytest.raises(SystemExit, match=r"x\.log: no log of this script"):
        since()


def test_no_path_of_the_machine_stands_in_a_log(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ci.IMAGES, str(tree.parent / "pictures"))
    where = ("-c", f"print({str(tree.parent / 'pictures' / 'data')!r}, {str(tree)!r})")
    _, text = told(tree, ci.Step("where", where))
    assert text.endswith("\n$LAVA_VPR_DATA/data .\n")
    assert str(tree.parent) not in text


@pytest.mark.parametrize(
    ("last", "result"),
    [
        ("12 passed, 60 deselected in 75.21s (0:01:15)", ("passed", "")),
        ("1 passed, 2 skipped in 0.50s", ("failed", "tests were skipped although the images are there")),
        ("2 skipped, 9 deselected in 0.50s", ("failed", "no test ran")),
        ("nothing", ("failed", "no test ran")),
    ],
)
def test_skipping_is_no_passing(last: str, result: tuple[str, str]) -> None:
    ended = ci.Ended(0, f"...s [100%]\nSKIPPED [2] a.py:1: 3 passed in 1.0s\n{last}\n", "")
    assert ci.judged(ci.Step("tests", ("-m", "pytest")), ended) == result
    assert ci.judged(ci.Step("tests", ("-m", "pytest")), ended._replace(code=1)) == ("failed", "exit code 1")


@pytest.mark.slow
def test_pytest_is_judged_by_what_it_prints_today(tree: Path) -> None:
    (tree / "test_it.py").write_text("import pytest\ndef test_a(): pass\ndef test_b(): pytest.skip('why')\n")
    steps = [
        ci.Step(which, ci._pytest("test_it.py", "-k", which)) for which in ("test_b", "test_a", "test_a or test_b")
    ]
    _, text = told(tree, *steps)
    assert [found[1:3] for found in STEP.findall(text)] == [
        ("failed", "no test ran"),
        ("passed", ""),
        ("failed", "tests were skipped although the images are there"),
    ]
    assert "-k 'test_a or test_b'\n" in text


def test_a_log_that_cannot_be_written_is_one_line(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ci.main(["--log", str(tree / "a.py" / "x.log")], [ci.Step("a", ("a.py",))], lambda line: None) == 1
    assert re.fullmatch(r".*x\.log: the log cannot be written: .+; name another with --log\n", capsys.readouterr().err)


def test_the_steps_name_what_is_there() -> None:
    assert len({step.name for step in ci.STEPS}) == len(ci.STEPS) == 4
    for step in ci.STEPS:
        module = step.words[1].replace(".", "/")
        files = [word for word in step.words if word.startswith("tests/")] or [f"{module}.py"]
        assert all((ROOT / name).exists() for name in files), step.words
    text = (ROOT / "tests" / "bench" / "test_workload.py").read_text(encoding="utf-8")
    assert ci.STEPS[-1].words[-1] in text


def test_the_committed_log_is_of_a_clean_run_of_all_steps_with_the_pinned_versions() -> None:
    """Red after a change of what is pinned: run `make ci-torch` on a committed tree, and commit the log."""
    text = ci.LOG.read_text(encoding="utf-8")
    found = head(text)
    assert tuple(found) == HEAD
    assert found["result"] == "passed"
    assert re.fullmatch(r"[0-9a-f]{40} \(clean\)", found["commit"])
    commit, sources = found["commit"].split()[0], found["sources"].split()[0]
    assert re.fullmatch("[0-9a-f]{16}", sources)
    assert ci.sources(commit) in (sources, ci.UNKNOWN)  # unknown to a clone without it
    assert found["images"] == "those of LAVA_VPR_DATA"
    assert [name for name, *_ in STEP.findall(text)] == [step.name for step in ci.STEPS]
    packages = dict(one.split(" ") for one in found["packages"].split(", "))
    assert tuple(packages) == ci.PACKAGES
    pins = dict(re.findall(r"^([\w.-]+)==(\S+)$", PINS, re.MULTILINE))
    here = pins.keys() & packages.keys()
    assert here >= {"torch", "lava-dl", "snntorch", "nirtorch", "neurobench"}
    assert {name: packages[name] for name in here} == {name: pins[name] for name in here}
    assert not re.search(r"(?<![\w./$])/(?:home|root|tmp|usr|work|var|opt)\b", text)
