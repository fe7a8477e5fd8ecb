"""What a season taught, from the command line: the same however images come, kept in a file of its own."""

from __future__ import annotations

import json
import shutil
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from support.common.commands import content, fails, figures, images, matches, run
from support.common.imagefiles import write_images
from support.common.teaching import teach_quickly

from lava_vpr import Localizer, load, localizer
from lava_vpr.backends import answering
from lava_vpr.backends.answering import answer_stream
from lava_vpr.backends.asking import Asking
from lava_vpr.cli import main
from lava_vpr.encoding import Keep
from lava_vpr.engine import gains
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.images.imagefiles import read_image
from lava_vpr.matching.answers import Together
from lava_vpr.report.season import Trusted, gains_table, section
from lava_vpr.season import file as season_file
from lava_vpr.storage import container
from lava_vpr.traverse import open_traverse


@pytest.fixture(autouse=True)
def quick_to_learn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A drive of eight images has several epochs."""
    teach_quickly(monkeypatch)


def watched(*words: object, model: str = "m.lvpr") -> list[dict[str, object]]:
    """What ``watch`` says of the route's queries."""
    paths = "".join(f"{path}\n" for path in images("query"))
    result = CliRunner().invoke(main, ["watch", model, "-", *map(str, words)], input=paths)
    assert result.exit_code == 0, result.output
    return [json.loads(line) for line in result.stdout.splitlines()]


@pytest.mark.parametrize("motion", ["none", "any"])
def test_the_answers_are_those_of_image_after_image(here: Path, motion: str, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("query", "--motion", motion)
    told = [matches(*words, *how) for how in ((), ("--adapt", 30), ("--learn",))]
    monkeypatch.setattr(answering, "BATCH", 3)
    assert matches(*words, "--learn") == told[2] != told[1]
    localizer = Localizer("m.lvpr", motion, learn=True)
    seen = [localizer.update(read_image(path)) for path in images("query")]
    assert [(str(one.place), repr(one.confidence)) for one in seen] == [(r["place"], r["confidence"]) for r in told[2]]
    learned = localizer.season
    assert learned is not None
    assert learned.answered == 8
    assert learned.taught >= 2
    assert (learned.gains < gains.FULL).any()
    localizer.save_season("s.lvps")
    kept = season_file.load("s.lvps")
    assert all(np.array_equal(getattr(kept, name), value) for name, value in vars(learned).items())


def test_a_page_s_images_stay_with_their_answers(here: Path) -> None:
    route = partial(answer_stream, load("m.lvpr"), open_traverse("query"), keep=Keep.THUMBNAILS)
    together = Together(motion="any")
    (whole,) = route(together=together)
    parts = list(route(together=together, asking=Asking(adapt=30, learn=True)))
    assert len(parts) > 1
    assert np.array_equal(np.concatenate([part.thumbnails for part in parts]), whole.thumbnails)


@pytest.mark.lava
@pytest.mark.parametrize("backend", ["bundle", "lava-fused"])
def test_backends_answer_alike(here: Path, backend: str) -> None:
    watched("--learn", "--season", "s.lvps")
    for how in (("--learn",), ("--season", "s.lvps"), ("--season", "s.lvps", "--motion", "any", "--query-views", 3)):
        told = matches("query", *how)
        assert told != matches("query", *how[2:])
        assert matches("query", *how, "--backend", backend) == told


def test_a_season_is_kept_and_gone_on_with(here: Path) -> None:
    watched("--learn", "--season", "s.lvps")
    first = Path("s.lvps").read_bytes()
    once = season_file.load("s.lvps")
    plain = matches("query")
    assert matches("query", "--season", "s.lvps") != plain
    run("eval", "m.lvpr", "query", "--season", "s.lvps", "--learn")
    watched("--season", "s.lvps")
    assert Path("s.lvps").read_bytes() == first
    watched("--learn", "--season", "s.lvps")
    twice = season_file.load("s.lvps")
    assert (once.answered, twice.answered) == (8, 16)
    assert twice.taught > once.taught
    assert matches("query") == plain


def test_what_was_learned_outlives_a_reset_and_a_change_of_the_map(here: Path) -> None:
    watched("--learn", "--season", "s.lvps")
    localizer = Localizer("m.lvpr", learn=True, season="s.lvps")
    localizer.update(read_image(images("query")[0]))
    before = localizer.season
    localizer.remove([7])
    assert localizer.season is before
    localizer.reset()
    assert localizer.season is before
    localizer.update(read_image(images("query")[1]))
    assert localizer.season is not None
    assert localizer.season.answered == 10


def test_a_part_of_the_route_in_another_season_teaches_as_sure_and_right_answers_do(here: Path) -> None:
    shutil.copytree("query", "part")
    Path("part", images("query")[0].name).unlink()
    watched("--learn", "--season", "s.lvps")
    train = ("train", "reference", "part", "-o", "n.lvpr", "--config", "quick.toml", "--pairs", "p.lvps")
    assert "season: p.lvps, taught by 7 of 7 images" in run(*train).stdout
    assert Path("n.lvpr").read_bytes() == Path("m.lvpr").read_bytes()
    robot = Localizer("m.lvpr", learn=True)
    found = [robot.update(read_image(path)).place for path in images("part")]
    assert found == list(range(1, 8))
    known, learned = season_file.load("p.lvps"), robot.season
    assert learned is not None
    assert all(np.array_equal(getattr(known, name), getattr(learned, name)) for name in ("gains", "sums", "mean"))
    Path("gt.txt").write_text("0: 5\n3: 1\n")
    assert "taught by 2 of 7 images" in run(*train, "--gt", "gt.txt").stdout
    assert asked("m.lvpr", "--season", "p.lvps") != asked("m.lvpr")


def test_pairs_that_cannot_teach_are_refused_before_anything_is_learned(here: Path) -> None:
    train = ("train", "reference", "query", "-o", "n.lvpr", "--config", "quick.toml")
    before = content(Path())
    for words, said in (
        ((*train, "--gt", "gt.txt"), "give --pairs FILE, too"),
        (("train", "reference", "-o", "n.lvpr", "--pairs", "p.lvps"), "--pairs needs two traverses"),
    ):
        assert said in " ".join(fails(*words, code=2).split())
    for words, said in (
        (("train", "reference", "query", "-o", "n.lvpr", "--preset", "paper", "--pairs", "p.lvps"), "--pairs needs"),
        ((*train, "--pairs", "none/p.lvps"), "the folder none does not exist"),
        ((*train, "--pairs", "n.lvpr"), "n.lvpr"),
        (("train", "reference", "no", "-o", "n.lvpr", "--pairs", "p.lvps"), "no: "),
    ):
        assert said in fails(*words)
    assert content(Path()) == before
    write_images(Path("other"), 2)
    said = fails("train", "reference", "other", "-o", "n.lvpr", "--config", "quick.toml", "--pairs", "p.lvps")
    assert said == ("other: no image is called as one of the map's places; say with --gt FILE which place each shows")


def test_eval_tells_what_taught_and_how_much_of_it_was_wrong(here: Path) -> None:
    plain = figures("query")
    told = figures("query", "--learn")
    assert set(told) - set(plain) == {"learned", "taught"}
    assert {name: value for name, value in told.items() if name in ("decoders", "baselines", "adapted")} == {
        name: plain[name] for name in ("decoders", "baselines", "adapted")
    }
    assert list(told["learned"]) == ["contrast"]
    assert {name: set(values) for name, values in told["taught"].items()} == {
        "single": {"answers", "wrong"},
        "filtered": {"answers", "wrong"},
    }
    assert told["taught"]["filtered"]["answers"] >= 2
    said = run("eval", "m.lvpr", "query", "--learn", "--motion", "none").stdout
    assert "contrast, gains" in said
    assert "answers taught" in said


def test_pages_show_what_is_trusted(here: Path) -> None:
    ways = {"query": ("--motion", "any"), "eval": ("--baseline", "template")}
    for command, words in ways.items():
        for how, there in ((("--learn",), True), ((), False)):
            run(command, "m.lvpr", "query", *words, *how, "--report", "r")
            text = Path("r", {"query": "query.html", "eval": "report.html"}[command]).read_text()
            assert ("What the map has learned to trust" in text) == there
            assert ("contrast, gains" in text) == (there and command == "eval")
            assert ("8 answers, of which" in text) == ("yellow where inputs are trusted" in text) == there


def test_of_vectors_no_picture_is_drawn() -> None:
    html = section(Trusted(gains_table(gains.Season.start(6)), None)).html()
    assert "0 answers, of which 0 taught" in html
    assert "<img" not in html


@pytest.mark.parametrize("motion", ["none", "any"])
def test_what_speaks_against_an_image_keeps_it_from_teaching(here: Path, motion: str) -> None:
    painted = [read_image(path) for path in images("query")]
    Path("painted").mkdir()
    for number, image in enumerate(painted):
        image[: len(image) // 5] = 0
        cv2.imwrite(f"painted/{number}.png", image)
    robot = Localizer("m.lvpr", motion, learn=True)
    assert all(robot.update(image).unlike >= 1 for image in painted)
    learned = robot.season
    assert learned is not None
    assert (learned.answered, learned.taught) == (8, 0)
    (turn,) = answer_stream(load("m.lvpr"), open_traverse("painted"), together=Together(motion=motion))
    assert all(sign.doubtful for sign in turn.signs)
    taught = figures("painted", "--learn", "--motion", motion)["taught"]
    assert {name: some["answers"] for name, some in taught.items()} == dict.fromkeys(taught, 0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--sequence", 2), "--learn needs probabilities, but sequences have no probabilities"),
        (("--query-views", 3), "--learn needs probabilities, but several views"),
        (("--adapt", "off"), "--learn needs adaptation"),
    ],
)
def test_what_cannot_teach(here: Path, words: tuple[object, ...], said: str) -> None:
    assert said in fails("query", "m.lvpr", "query", "--learn", *words)


def test_a_file_that_is_no_season_of_this_model_is_named(here: Path) -> None:
    watched("--learn", "--season", "s.lvps")
    whole = Path("s.lvps").read_bytes()
    query = ("query", "m.lvpr", "query", "--season", "s.lvps")
    header, arrays = container.load(Path("s.lvps"), "season")
    for change, what in (
        ({"gains": arrays["gains"] + np.uint8(1)}, "gains with values"),
        ({"sums": arrays["sums"][:, 1:]}, "sums of shape"),
        ({"mean": arrays["mean"] * np.nan}, "mean with values that are not finite"),
        ({"more": arrays["mean"]}, "an unexpected array"),
    ):
        container.save(Path("s.lvps"), "season", header, {**arrays, **change})
        assert f"s.lvps: the season {'has' if 'more' in change else 'has no valid'} {what}" in fails(*query)
    for key, value in {"taught": 9, "inputs_of": "x", "answered": -1}.items():
        container.save(Path("s.lvps"), "season", {**header, key: value}, arrays)
        assert f"s.lvps: the season has no valid {key}" in fails(*query)
    container.save(Path("s.lvps"), "season", {**header, "inputs_of": "0" * 64}, arrays)
    assert "the season was learned with other inputs" in fails(*query)
    Path("s.lvps").write_bytes(whole[:-9])
    assert "s.lvps: the season is damaged" in fails(*query)
    assert "is a 'lava-vpr model 1' file" in fails("query", "m.lvpr", "query", "--season", "m.lvpr")
    assert "no.lvps" in fails("query", "m.lvpr", "query", "--season", "no.lvps")
    assert "is also an input" in fails(*query, "-o", "s.lvps")
    assert "is also an input" in fails("watch", "m.lvpr", "query", "--learn", "--season", "m.lvpr")


def test_localizers_refuse_what_no_season_is(here: Path) -> None:
    with pytest.raises(InputError):
        Localizer("m.lvpr", learn=1)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="there is no season"):
        Localizer("m.lvpr").save_season("s.lvps")


@pytest.fixture
def known(here: Path) -> Path:
    """A season that was learned with ``m.lvpr``."""
    watched("--learn", "--season", "s.lvps")
    return Path("s.lvps")


def asked(model: str, *words: object) -> list[list[str]]:
    """Rows of ``query``, without the times of files."""
    return [line.split(",") for line in run("query", model, "query", "-o", "-", *words).stdout.splitlines()]


def test_a_season_is_shown_drawn_put_away_applied_and_forgotten(known: Path) -> None:
    whole, model = known.read_bytes(), Path("m.lvpr").read_bytes()
    words = ("--picture", "p.png", "--save", "kept.lvps", "--apply", "a.lvpr", "--forget")
    said = run("season", "m.lvpr", known, *words).stdout
    assert "8 answers" in said
    gained = cv2.imread("p.png")
    assert gained.shape == (480, 640, 3)
    assert Path("kept.lvps").read_bytes() == whole
    assert Path("m.lvpr").read_bytes() == model
    assert (season_file.load(known).gains == gains.FULL).all()
    assert asked("m.lvpr", "--season", known) == asked("m.lvpr")
    run("season", "m.lvpr", known, "--picture", "q.png", "--apply", "same.lvpr")
    assert (cv2.imread("q.png") != gained).any()
    assert asked("same.lvpr") == asked("m.lvpr") != asked("a.lvpr")
    run("deploy", "m.lvpr", "--target", "loihi2", "-o", "b", "--season", "kept.lvps")
    assert asked("b") == asked("a.lvpr")


def test_backends_are_compared_under_a_season(known: Path) -> None:
    how = ("verify", "m.lvpr", "query", "--backend", "bundle", "--json", "v.json")
    compared = []
    for words in ((), ("--season", known)):
        run(*how, *words)
        compared.append(json.loads(Path("v.json").read_text())["backends"]["bundle"])
    assert [one["equal"] for one in compared] == [True, True]
    assert compared[0]["spikes_by_population"] != compared[1]["spikes_by_population"]


@pytest.mark.parametrize(
    "change",
    [
        ("extend", "m.lvpr", "further"),
        ("remove", "m.lvpr", "3"),
        ("merge", "m.lvpr", "f.lvpr"),
    ],
    ids=lambda words: words[0],
)
def test_a_changed_map_has_the_inputs_that_a_season_is_of(known: Path, change: tuple[str, ...]) -> None:
    write_images(Path("further"), 2)
    run("train", "further", "-o", "f.lvpr", "--config", "quick.toml")
    whole = known.read_bytes()
    run(*change, "-o", "n.lvpr")
    assert known.read_bytes() == whole
    assert asked("n.lvpr", "--season", known) != asked("n.lvpr")
    watched("--learn", "--season", known, model="n.lvpr")
    assert season_file.load(known).answered == 16


def test_a_map_of_other_inputs_is_refused_in_a_line(known: Path) -> None:
    Path("other.toml").write_text(f"{Path('quick.toml').read_text()}[encoder]\ncell = 8\n")
    run("train", "reference", "-o", "other.lvpr", "--config", "other.toml")
    before = content(Path())
    for words in (
        ("query", "other.lvpr", "query"),
        ("eval", "other.lvpr", "query"),
        ("verify", "other.lvpr", "query"),
        ("bench", "other.lvpr", "query"),
        ("deploy", "other.lvpr", "--target", "loihi2", "-o", "b"),
        ("watch", "other.lvpr", "query", "--learn"),
    ):
        assert "the season was learned with other inputs" in fails(*words, "--season", known)
    assert "other inputs" in fails("season", "other.lvpr", known, "--forget", "--apply", "a.lvpr")
    assert content(Path()) == before


def test_a_season_that_cannot_be_written_is_refused_first_or_told_last(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = fails("watch", "m.lvpr", "query", "--learn", "--season", "none/s.lvps")
    assert said.startswith("none/s.lvps: the folder none does not exist")
    Path("there").mkdir()
    save = season_file.save

    def late(season: gains.Season, path: Path) -> None:
        Path("there").rmdir()
        save(season, path)

    monkeypatch.setattr(localizer, "save_season", late)
    paths = "".join(f"{path}\n" for path in images("query"))
    words = ["watch", "m.lvpr", "-", "--learn", "--season", "there/s.lvps"]
    result = CliRunner().invoke(main, words, input=paths)
    assert (result.exit_code, len(result.stdout.splitlines())) == (1, 8)
    assert result.stderr.splitlines()[-1].startswith("lava-vpr: error: there/s.lvps: ")
