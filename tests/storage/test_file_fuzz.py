"""Honest files changed at random: each reads and is equal when written again, or costs one clear line."""

from __future__ import annotations

import random
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from support.common import children
from support.fuzz import corpus, damage, run
from support.fuzz.changes import sealed_bundle
from support.fuzz.corpus import Corpus

from lava_vpr import maps, model as model_file


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Corpus:
    """The honest files."""
    return corpus.make(tmp_path_factory.mktemp("honest"))


ROOT = Path(__file__).resolve().parents[2]


def fuzz(*words: object, code: str = "") -> subprocess.CompletedProcess[str]:
    """Run the fuzzer in a process of its own, after ``code``."""
    waits = "os.fsync = os.fstat"  # as in conftest
    command = f"import sys, time, os\n{waits}\nfrom support.fuzz import run\n{code}\nsys.exit(run.main())"
    environment = {"PYTHONPATH": str(ROOT / "tests"), "PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    environment["OPENBLAS_NUM_THREADS"] = "1"
    return children.run(
        [sys.executable, "-c", command, *words], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )


def test_all_honest_files_are_tried(honest: Corpus) -> None:
    """That each is equal when it is written again is for the fuzzer, which fails otherwise."""
    assert len(run.honest(honest)) == 66
    for files in honest.files["bundle"].values():
        assert sealed_bundle(files).keys() == files.keys()


@pytest.mark.parametrize("format", ["list", "image"])
def test_an_honest_file_that_is_not_equal_is_told(honest: Corpus, format: str, monkeypatch: pytest.MonkeyPatch) -> None:
    name, files = next(iter(honest.files[format].items()))
    one = replace(honest, files={format: {name: files}})
    assert not list(run.unsound(one))
    with monkeypatch.context() as patch:
        patch.setitem(run.READERS, format, lambda *_: run.equal(1.0, 2.0, "steps"))
        (told,) = run.unsound(one)
    assert told.startswith("UnequalError: honest, Case(")
    monkeypatch.setattr(run, "tried", lambda *_: (run.REFUSED, "cut"))
    (told,) = run.unsound(one)
    assert told.startswith(f"refused: honest, Case(format={format!r}")
    assert told.endswith("\n    cut")


@pytest.mark.parametrize("wrong", [[], ["UnequalError: honest"]])
def test_an_honest_file_that_is_not_equal_is_a_failure(
    honest: Corpus, wrong: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for owner, name in ((run, "guard"), (run.cv2, "setNumThreads")):  # for a process of its own
        monkeypatch.setattr(owner, name, lambda *_: None)
    monkeypatch.setattr(corpus, "make", lambda _: honest)
    monkeypatch.setattr(run, "unsound", lambda _: iter(wrong))
    assert run.main(["--count", "0"]) == len(wrong)
    assert capsys.readouterr().out.startswith("".join(wrong))


@pytest.mark.parametrize("name", ["float", "views"])
def test_models_that_lost_places(honest: Corpus, name: str, tmp_path: Path) -> None:
    """What is left of a model is equal when it is written again, and so is what it is merged to."""
    whole = model_file.load(honest.folder / f"{name}.lvpr")
    less = maps.remove(whole, [0, 4])
    for made in (less, maps.merge([less, whole], allow_duplicates=True)):
        model_file.save(made, tmp_path / "m.lvpr")
        case = run.Case("model", name, {"m.lvpr": (tmp_path / "m.lvpr").read_bytes()})
        assert run.tried(case, honest) == (run.SOUND, "")
        assert any(part.removed for part in made.stretches)


@pytest.mark.parametrize(
    ("format", "name", "kind", "why"),
    [
        ("vectors", "v.npy", "cut", "is cut"),
        ("vectors", "v.npy", "turned", "zeros at its end"),
        ("vectors", "plain.npz", "turned", "has a checksum"),
        ("vectors", "plain.npz", "doubled", "names an array twice"),
        ("video", "v.avi", "turned", "7, not 8"),
    ],
)
def test_a_damaged_file_that_is_taken_is_told(
    honest: Corpus, format: str, name: str, kind: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readers that take it all, and give what is told of the whole file and then of the damaged one."""
    given = iter([(8, b"whole", False), (7 if "7" in why else 8, b"other", "zeros" in why)])
    monkeypatch.setitem(damage.READERS, format, lambda _: next(given))
    whole = honest.files[format][name][name]
    (tmp_path / name).write_bytes(whole[:-1] + b"?")
    with pytest.raises(damage.WrongError, match=f"and taken: .*{why}"):
        damage.judged(format, tmp_path / name, whole, kind)


def test_seed_and_number_decide_a_case(honest: Corpus) -> None:
    first = run.made(honest, 3, 17)
    random.seed(5)  # nobody's but the case's own generator is asked
    again = run.made(honest, 3, 17)
    assert (first, first.files) == (again, again.files)
    assert run.made(honest, 3, 18).files != first.files


FIRST = [pytest.param(0, 100, 0), pytest.param(0, 400, 100)]
FIRST += [pytest.param(1, 2500, first, marks=pytest.mark.slow) for first in range(0, 10_000, 2500)]


@pytest.mark.quick(1)
@pytest.mark.parametrize(("seed", "count", "first"), FIRST)
def test_what_is_taken_is_equal_when_it_is_written_again(seed: int, count: int, first: int, tmp_path: Path) -> None:
    done = fuzz("--seed", seed, "--count", count, "--first", first, "--log", tmp_path / "log")
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:] + (tmp_path / "log").read_text()[-200:]


PLANTED = {
    "a traceback": ("{}['steps']", 1, "KeyError: seed 0, number 0"),
    "memory": ("bytearray(2 * run.MEMORY)", 1, "MemoryError: seed 0, number 0"),
    "a message without a remedy": ("raise_(run.LavaVprError('radius is nan'))", 1, "NOT THE FILE'S NAME FIRST"),
    "another value": ("run.equal(1.0, 2.0, 'steps')", 1, "UnequalError: seed 0, number 0"),
    "the end of the process": ("os.abort()", -6, ""),
    "no end": ("spin()", -27, ""),
}
"""Faults of a reader: what it does, how the run ends, and what it prints."""


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", PLANTED)
def test_a_reader_that_fails_is_told(name: str, tmp_path: Path) -> None:
    fault, code, told = PLANTED[name]
    planted = f"""
from support.fuzz import corpus
def raise_(error): raise error
def spin():
    while True: pass
run.CPU_SECONDS = 0.5
corpus.make = lambda folder: corpus.Corpus(folder, {{"list": {{"a": {{"a.txt": b"a"}}}}}})
run.SHARES = {{"list": 1}}
run.honest = lambda corpus: []
run.READERS["list"] = lambda *_: {fault}
"""
    done = fuzz("--count", 1, "--log", tmp_path / "log", code=planted)
    assert done.returncode == code, done.stderr[-2000:]
    assert told in done.stdout
    assert (tmp_path / "log").read_text().startswith("0 list a")


@pytest.mark.parametrize(
    "message",
    [
        "/a/b: is empty",
        "/a/b: is empty; train again\nand again",
        "/a/b: is \x1b[31mempty; train again",
        "/a/c: is empty; train again",
        f"/a/b: is {'empty' * 200}; train again",
        "/a/b: needs more than this machine has memory for; use another",
    ],
)
def test_a_message_is_one_short_printable_line_with_file_and_remedy(message: str) -> None:
    assert run.wrong_with(message, Path("/a/b"))
    assert not run.wrong_with("/a/b: is empty; train again", Path("/a/b"))
