"""The real command in surroundings that nobody wished for: closed streams, strange users, full caches.

Whatever the process finds, it does its work or says in one line why not, leaves nothing behind, and shows no traceback.
"""

from __future__ import annotations

import io
import os
import re
import resource
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner
from rich.text import Text
from support.common import children, surroundings
from support.common.commands import opened, run
from support.common.imagefiles import write_images
from support.common.surroundings import AT_IMPORT, QUERY, Ended, done

from lava_vpr.cli import common, main
from lava_vpr.show.table import Table

FULL = Path("/dev/full")
STRANGER = 54321  # a user whom no list of users names
READ_ALL = "-all,+dac_read_search"
LOST = [name for name in os.environ if name.startswith(("HOME", "XDG", "NUMBA", "MPL", "USER", "LOGNAME"))]
KERNELS = "compiled kernels cannot be kept in "


def stranger(words: Sequence[str]) -> list[str]:
    """The words of a command for a user without name or home, who may read everything but write nothing of ours."""
    ids = ["--reuid", str(STRANGER), "--regid", str(STRANGER), "--clear-groups"]
    return ["setpriv", *ids, "--inh-caps", READ_ALL, "--ambient-caps", READ_ALL, "--bounding-set", READ_ALL, *words]


def no_stranger() -> str:
    """Why commands cannot be run as another user; empty if they can."""
    if os.getuid() != 0:
        return "only root can become another user"
    if shutil.which("setpriv") is None:
        return "setpriv is missing"
    alive = children.run(stranger(["true"]), capture_output=True, check=False)
    return "" if alive.returncode == 0 else "another user's rights cannot be set here"


def one_line(ended: Ended, *words: str) -> None:
    """It failed with one line on stderr that holds all of ``words``."""
    assert ended.code == 1, ended
    assert len(ended.lines) == 1, ended.err
    assert ended.lines[0].startswith("lava-vpr: error: ")
    assert all(word in ended.lines[0] for word in words), ended.err
    assert not ended.left


def test_closed_streams(here: Path) -> None:
    """Nothing that is opened takes the place of a closed stream: what is printed would be written into it."""
    done(surroundings.run(here, *QUERY, "q.csv", closed=(0, 1, 2)), "q.csv")
    assert Path("q.csv").read_text().startswith("query,query_name,place")
    failed = surroundings.run(here, "query", "none.lvpr", "query", "-o", "n.csv", closed=(2,))
    assert (failed.code, failed.err, failed.made) == (1, "", [])


@pytest.mark.parametrize("words", [("--version",), ("fit", "m.lvpr", "--target", "kapoho-bay")])
def test_full_output(here: Path, words: tuple[str, ...]) -> None:
    one_line(surroundings.run(here, *words, out=FULL), "stdout: No space left on device; free some space")


def test_letters_that_the_terminal_lacks(here: Path) -> None:
    """ASCII has no check mark; a file name that is no text is shown by its bytes."""
    name = os.fsdecode(b"q\xe2\x9c\x93\xff.csv")
    ended = surroundings.run(here, *QUERY, name, set_to={"PYTHONIOENCODING": "ascii"})
    done(ended, name)
    assert r"q\u2713\udcff.csv" in ended.out


@pytest.mark.slow
def test_neither_home_nor_name(here: Path) -> None:
    """A user whom no list knows, as in a container with a number for a user, and who has no cache yet."""
    why = no_stranger()
    if why:
        pytest.skip(why)
    ended = surroundings.run(here, "fit", "m.lvpr", "--target", "kapoho-bay", without=LOST, prefix=stranger)
    assert (ended.code, ended.err, ended.made) == (0, "", [])
    assert ended.left == [f"lava-vpr-kernels-{STRANGER}"]  # a cache, closed to others, for the next time


def test_the_working_directory_is_gone(here: Path) -> None:
    program = ["-c", "import os; os.mkdir('gone'); os.chdir('gone'); os.rmdir('../gone')\n" + AT_IMPORT, "0", ""]
    words = ["query", here / "m.lvpr", here / "query", "-o", "q.csv"]
    ended = surroundings.run(here, *words, program=[sys.executable, *program])
    one_line(ended, "the working directory does not exist any more; change to another")


LOGS = {"OPENCV_FFMPEG_LOGLEVEL": "-8"}  # a variable of OpenCV's makes the command try it in a child
CROWDED = {
    "files": ({resource.RLIMIT_NOFILE: 8}, {}, 0),
    "files for the trial of OpenCV": ({resource.RLIMIT_NOFILE: 8}, LOGS, 0),
    "size of files": ({resource.RLIMIT_FSIZE: 1024}, {"NUMBA_CACHE_DIR": "cache"}, 0),
    "no size": ({resource.RLIMIT_FSIZE: 0}, {}, 1),
    "memory for cv2": ({resource.RLIMIT_AS: 100 << 20}, {}, 1),
    "memory for the trial of OpenCV": ({resource.RLIMIT_AS: 100 << 20}, LOGS, 1),
    "memory for numba": ({resource.RLIMIT_AS: 300 << 20}, {}, 1),
    "home": ({}, {"HOME": "/dev/null/home", "TMPDIR": "/dev/null", "NUMBA_CACHE_DIR": "/proc/cache"}, 0),
    "terminal": ({}, {"COLUMNS": "garbage", "LINES": "-5", "TERM": "no-such", "LC_ALL": "xx_YY"}, 0),
    "narrow": ({}, {"COLUMNS": "1"}, 0),
    "much": ({}, {f"V{k}": "x" * 100_000 for k in range(12)}, 0),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CROWDED)
def test_little_of_everything(here: Path, case: str) -> None:
    """Each limit of the system, and an environment that makes no sense: work or one line."""
    limits, variables, code = CROWDED[case]
    ended = surroundings.run(here, *QUERY, "q.csv", limits=limits, set_to=variables)
    if code:
        one_line(ended, "memory" if "memory" in case else "q.csv: cannot be written (File too large)")
        assert not ended.made
    else:
        assert [line for line in ended.lines if not line.startswith("note: " + KERNELS)] == []
        assert ended.code == 0
        assert not ended.left
        assert set(ended.made) <= {"q.csv", "cache"}


WRONG = {
    "OPENCV_TRACE": ("abc", "OpenCV cannot start", "'abc'"),
    "OPENCV_IO_MAX_IMAGE_PIXELS": ("abc", "OpenCV cannot start (what(): stoull)", "'abc'"),
    "NUMBA_NUM_THREADS": ("0", "numba cannot start (Number of threads specified must be > 0.)"),
    "NUMBA_OPT": ("abc", "numba cannot start (Environment variable 'NUMBA_OPT' is defined"),
    "NUMBA_CPU_FEATURES": ("abc", "numba cannot start", "'abc'"),
    "LAVA_VPR_MAX_ROWS": ("abc", "LAVA_VPR_MAX_ROWS is 'abc', but must be a whole number above 0"),
}


@pytest.mark.parametrize("variable", WRONG)
def test_a_variable_that_nobody_can_read_is_one_line_at_once(variable: str, here: Path) -> None:
    """OpenCV and numba would abort, or show where in their source they gave up."""
    value, *words = WRONG[variable]
    one_line(surroundings.run(here, "query", "none", "-o", "q.csv", set_to={variable: value}), *words, "unset")


def test_a_variable_that_is_misspelt_is_told(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LAVA_VPR_MAX_ROW", "9")
    monkeypatch.setenv("LAVA_VPR_DATA", "of the benchmarks")
    told = CliRunner().invoke(main, ["fit", "m.lvpr", "--target", "loihi2"]).stderr
    assert (
        told.splitlines()[0] == "note: LAVA_VPR_MAX_ROW is no variable that lava-vpr knows; is LAVA_VPR_MAX_ROWS meant?"
    )
    assert "LAVA_VPR_DATA" not in told


def test_drawings_are_ours_whatever_matplotlib_is_told(here: Path) -> None:
    command = ("fit", "m.lvpr", "--target", "loihi2", "--picture", "p.svg")
    done(surroundings.run(here, *command, set_to={"MPLBACKEND": "none", "MATPLOTLIBRC": "/dev/zero"}), "p.svg")


WRITERS: dict[str, tuple[tuple[str, ...], str]] = {
    "events": (("synth", "new", "--places", "2", "--events"), "new: cannot be written"),
    "events-npz": (("synth", "new", "--places", "2", "--events", "npz"), "new: cannot be written"),
    "images": (("synth", "new", "--places", "2"), "new: cannot be written"),
    "bundle": (("deploy", "m.lvpr", "--target", "loihi2", "-o", "new"), "new: the bundle cannot be written"),
    "nir": (("export", "m.lvpr", "-o", "new.nir"), "new.nir: the NIR graph cannot be written"),
    "netx": (("export", "m.lvpr", "-o", "new.net"), "new.net: the NetX file cannot be written"),
    "model": (
        ("merge", "m.lvpr", "m.lvpr", "--allow-duplicates", "-o", "new.lvpr"),
        "new.lvpr: the model cannot be written",
    ),
    "figures": (("eval", "m.lvpr", "query", "--json", "new.json"), "new.json: cannot be written"),
    "picture": (("fit", "m.lvpr", "--target", "loihi2", "--picture", "new.svg"), "new.svg: cannot be written"),
    "bag": (
        ("query", "m.lvpr", "query", "--motion", "any", "--stamps", "query_positions.csv", "--bag", "new"),
        "new: cannot be written",
    ),
    "page": (("query", "m.lvpr", "query", "--report", "new"), "new/query.html: the report cannot be written"),
    "texts": (("datasets", "--json", "new.json"), "new.json: cannot be written"),
}


@pytest.mark.parametrize(
    "what", [name if name == "events" else pytest.param(name, marks=pytest.mark.slow) for name in WRITERS]
)
def test_no_room_for_what_is_written(here: Path, what: str) -> None:
    """A library that cannot write the rest of a file when the interpreter ends may end with a signal."""
    words, message = WRITERS[what]
    ended = surroundings.run(here, *words, limits={resource.RLIMIT_FSIZE: 1000})
    told = [line for line in ended.lines if not line.startswith("note: ")]
    assert ended.code == 1, ended
    assert len(told) == 1, ended.err
    assert told[0].startswith(f"lava-vpr: error: {message} (File too large); "), told
    assert (ended.left, ended.made) == ([], [])


@pytest.mark.slow
def test_a_full_disk_for_kernels(here: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Kernels are compiled and cannot be kept; a note says so once."""
    disk = tmp_path_factory.mktemp("disk")
    if children.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", disk], check=False).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        ended = surroundings.run(here, *QUERY, "q.csv", set_to={"NUMBA_CACHE_DIR": str(disk)})
    finally:
        children.run(["umount", disk], check=True)
    done(ended, "q.csv")
    assert len(ended.lines) == 1
    assert ended.lines[0].startswith("note: " + KERNELS + str(disk))
    assert "No space left on device" in ended.lines[0]


PROGRAM = "import sys; from lava_vpr.cli import main; main(sys.argv[1:], standalone_mode=False); print(*sys.modules)"

NOT_FOR_A_QUERY = (
    "IPython",
    "gpxpy",
    "jinja2",
    "lava",
    "lava_vpr.bench",
    "lava_vpr.deploy.bundle",
    "lava_vpr.deploy.mapping",
    "lava_vpr.deploy.registers",
    "lava_vpr.maps",
    "lava_vpr.report",
    "lava_vpr.synthetic",
    "lava_vpr.training",
    "matplotlib",
    "networkx",
    "pandas",
    "rich.markdown",
    "rich.progress",
    "scipy.sparse",
    "scipy.spatial",
    "scipy.stats",
    "sklearn",
    "torch",
)
"""Packages and modules; scipy.linalg is imported by numba itself."""


@pytest.fixture(scope="module")
def imported(made: Path, tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """The names of all modules that ``lava-vpr query`` has imported when it is done with an image."""
    out = tmp_path_factory.mktemp("startup") / "m.csv"
    words = ["query", str(made / "m.lvpr"), str(min((made / "query").iterdir())), "-o", str(out)]
    done = children.run([sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(out.read_text().splitlines()) == 2
    return set(done.stdout.split())


def test_a_query_imports_what_it_needs(imported: set[str]) -> None:
    assert {"numba", "cv2", "click", "lava_vpr.backends.answering"} <= imported


@pytest.mark.parametrize("name", NOT_FOR_A_QUERY)
def test_a_query_imports_nothing_else(imported: set[str], name: str) -> None:
    assert {module for module in imported if module == name or module.startswith(f"{name}.")} == set()


NASTY = "\x1b]0;taken\x07[red]x[b]\r\u202e:smile:\x9b2J\n"
"""A new title of the window, markup, a return to the line's beginning, text from right to left, an emoji's name, a
screen cleared, and a line's end."""
ESCAPED = r"\x1b]0;taken\x07[red]x[b]\r\u202e:smile:\x9b2J"


def is_plain(text: str) -> bool:
    """Whether a terminal does nothing with ``text`` but show it, line by line."""
    return all(character.isprintable() for character in text.replace("\n", ""))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of a nasty name with images of such names, and their model."""
    root = tmp_path_factory.mktemp("place") / NASTY
    write_images(root / "ref", 4)
    for k, file in enumerate(sorted((root / "ref").iterdir())):
        file.rename(file.with_name(f"{k}{NASTY}.png"))
    shutil.copytree(root / "ref", root / "query")
    (root / "quick.toml").write_text("[network]\nsteps = 32\n[learning]\nsteps = 40\nepochs = 2\n")
    run("train", root / "ref", "-o", root / "m.lvpr", "--config", root / "quick.toml")
    return root


COMMANDS = [
    "train {}/ref -o {}/n.lvpr --config {}/quick.toml",
    "query {}/m.lvpr {}/query -o {}/q.csv",
    "fit {}/m.lvpr --target loihi2 --picture {}/p.svg",
    "synth {}/s --places 2",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_what_a_command_says_of_files_is_plain_text(command: str, place: Path) -> None:
    result = run(*(word.replace("{}", str(place)) for word in command.split()))
    assert ESCAPED in result.stdout
    assert is_plain(result.output)


DAMAGE = [
    ("eval {}/m.lvpr {}/query", "query"),
    ("train {}/ref -o {}/n.lvpr", "ref"),
    ("query {}/m.lvpr {}/query -o {}/q.csv", "query"),
]


@pytest.mark.parametrize(("command", "folder"), DAMAGE)
def test_a_refusal_names_a_file_in_plain_text(command: str, folder: str, place: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "w"
    shutil.copytree(place, damaged)
    (damaged / folder / f"2{NASTY}.png").write_bytes(b"no image")
    result = CliRunner().invoke(main, [word.replace("{}", str(damaged)) for word in command.split()])
    assert result.exit_code == 1
    assert ESCAPED in result.stderr
    assert is_plain(result.stderr)
    assert len(result.stderr.splitlines()) == 1


def test_a_progress_bar_shows_names_as_text(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = opened(monkeypatch, 400)
    with common.progress_bar(NASTY, 2) as advance:
        advance(1, NASTY)
    assert terminal.said.count(ESCAPED) >= 2
    assert is_plain(terminal.said.replace("\r", ""))


def test_tables_show_names_as_text(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = io.StringIO()
    monkeypatch.setattr(sys, "stdout", shown)
    word = NASTY.strip()
    common.print_whole(Table([word], [[word], ["-" * 60]], [word], word))
    common.console.print(Text(word))
    assert shown.getvalue().count(ESCAPED) == 4
    assert is_plain(shown.getvalue())
    assert len({len(line) for line in shown.getvalue().splitlines() if "│" in line}) == 1


@pytest.mark.parametrize(("command", "name"), [("eval", "report.html"), ("query", "query.html")])
def test_a_page_shows_names_as_text(command: str, name: str, place: Path, tmp_path: Path) -> None:
    """No file can be named ``</script>``, but these words need no slash."""
    queries, folder = tmp_path / "query", tmp_path / NASTY
    shutil.copytree(place / "query", queries)
    for k, file in enumerate(sorted(queries.iterdir())):
        file.rename(file.with_name(f"{k}\"'><img src=x onerror=alert(1)><script>alert(2)<!--&.png"))
    result = run(command, place / "m.lvpr", queries, "--report", folder)
    assert ESCAPED in result.stdout
    assert is_plain(result.output)
    page = (folder / name).read_text()
    assert re.search(r"onerror=alert\(1\)(&gt;|>)", page)
    assert "<img src=x" not in page
    assert len(re.findall("<script", page)) == 2
    assert "<!--&" not in page
