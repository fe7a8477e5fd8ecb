"""What a season taught, from the command line: the same however images come, kept in a file of its own."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.commands import fails, figures, images, matches, run

from lava_vpr import Localizer, load
from lava_vpr.backends import answering, season as season_file, teaching
from lava_vpr.backends.answering import answer_stream
from lava_vpr.backends.asking import Asking
from lava_vpr.cli import main
from lava_vpr.encoding import Keep
from lava_vpr.engine import gains
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.images.imagefiles import read_image
from lava_vpr.matching.answers import Together
from lava_vpr.storage import container
from lava_vpr.traverse import open_traverse


@pytest.fixture(autouse=True)
def quick_to_learn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Answers of all sorts teach, and two are enough."""
    monkeypatch.setattr(gains, "EPOCH", 2)
    monkeypatch.setattr(gains, "ENOUGH", 1)
    monkeypatch.setattr(teaching, "ALONE", 0.0)
    monkeypatch.setattr(teaching, "TRACKED", 0.0)


def watched(*words: object) -> list[dict[str, object]]:
    """What ``watch`` says of the route's queries."""
    paths = "".join(f"{path}\n" for path in images("query"))
    result = CliRunner().invoke(main, ["watch", "m.lvpr", "-", *map(str, words)], input=paths)
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
        assert f"s.lvps: the season {'has' if 'more' in change else 'lacks or garbles'} {what}" in fails(*query)
    for key, value in {"taught": 9, "inputs_of": "x", "answered": -1}.items():
        container.save(Path("s.lvps"), "season", {**header, key: value}, arrays)
        assert f"s.lvps: the season lacks or garbles {key}" in fails(*query)
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
