"""Events from the command line: a synthetic drive written, learned, and recognised from another; refusals."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.common import children
from support.common.commands import fails, linked_route, matches, run
from support.common.eventfiles import EVENT, Made, aedat4, dsec, made

from lava_vpr.config import EncoderConfig, for_events, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import Keep, activity_of, encode_traverse, encode_views
from lava_vpr.events.files import open_events
from lava_vpr.inputs.windows import saturated
from lava_vpr.learning.route import train
from lava_vpr.localizer import Localizer
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.model import load
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.synthetic import drives as drives_of
from lava_vpr.training.loop import train as train_encoded
from lava_vpr.traverse import open_traverse

CONFIG = "[network]\nsteps = 64\n[learning]\nsteps = 100\nepochs = 4\n[events]\nhot_pixels = 6.0\n"
POSITIONS = ("--positions", "w/reference_positions.csv")
QUERIES = ("--query-positions", "w/query_positions.csv")
EVERY = ("--every", "0.5")


@pytest.fixture(scope="module", autouse=True)
def _fewer_pictures() -> Iterator[None]:
    """Between two pictures lie twice as many metres, so that drawing them takes half the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drives_of, "STEP_M", 2 * drives_of.STEP_M)
        yield


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two synthetic drives of an event camera, and a model of the first."""
    return made_drives(tmp_path_factory.mktemp("events"))


def made_drives(folder: Path) -> Path:
    """`drives` in ``folder``."""
    run("synth", folder / "w", "--places", 5, "--events", "--query-condition", "rain", "--query-speed", 15)
    (folder / "quick.toml").write_text(CONFIG)
    reference = ("train", folder / "w/reference_events.h5", *EVERY, "--config", folder / "quick.toml")
    run(*reference, "--positions", folder / POSITIONS[1], "--window-ms", 150, "-o", folder / "m.lvpr")
    return folder


@pytest.fixture
def there(drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of its own to work in, which sees what was made."""
    monkeypatch.chdir(tmp_path)
    with linked_route(drives, tmp_path) as folder:
        yield folder


def test_a_drive_of_events_is_recognised_from_another_at_another_speed(there: Path) -> None:
    result = run("eval", "m.lvpr", "w/query_events.h5", *EVERY, *QUERIES, "--radius", 8, "--json", "f.json",
                 "--report", "report")  # fmt: skip
    told = json.loads(Path("f.json").read_text())
    assert told["queries"] >= 10
    assert told["decoders"]["contrast"]["recall_at_1"] >= 0.8
    assert "windows of" in result.stderr
    assert "hot pixels" in result.stderr
    model = load("m.lvpr")
    assert model.config.events.window_ms == 150
    assert model.config.events.hot_pixels == 6
    assert model.place_names[1] == "window 000001"
    page = Path("report/report.html").read_text()
    assert "window 000001" in page
    assert "data:image" in page


@pytest.mark.slow
def test_the_same_at_the_step_that_ships(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drives_of, "STEP_M", 0.2)
    monkeypatch.chdir(tmp_path)
    there = made_drives(tmp_path)
    test_a_drive_of_events_is_recognised_from_another_at_another_speed(there)
    test_a_query_is_answered_with_its_place_in_time(there)


def test_a_query_is_answered_with_its_place_in_time(there: Path) -> None:
    rows = matches("w/query_events.h5", *EVERY, *QUERIES)
    assert rows[2]["query_name"] == "window 000002"
    assert float(rows[0]["time"]) == pytest.approx(1_736_942_400.075, abs=1e-3)  # the middle of the first 150 ms
    assert np.median([float(row["error_m"]) for row in rows if row["error_m"]]) < 8


@pytest.mark.slow
def test_bench_and_verify_take_events(there: Path) -> None:
    run("bench", "m.lvpr", "w/query_events.h5", "--every", 1, "--places", "0:3", "--limit", 2, "--json", "b.json")
    assert json.loads(Path("b.json").read_text())
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "verified")
    told = run("verify", "verified", "w/query_events.h5", "--every", 1, "--places", "0:3", "--backend", "bundle")
    assert "bundle" in told.output


def test_bundles_and_python_take_events(there: Path) -> None:
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "kb")
    run("query", "m.lvpr", "w/query_events.h5", *EVERY, "-o", "host.csv", "--seed", 5)
    run("query", "kb", "w/query_events.h5", *EVERY, "-o", "bundle.csv", "--seed", 5, "--backend", "bundle")
    assert Path("host.csv").read_bytes() == Path("bundle.csv").read_bytes()
    model = load("m.lvpr")
    queries = open_traverse("w/query_events.h5", every=0.5, events=model.config.events)
    rows = matches("w/query_events.h5", *EVERY, "--seed", 5)
    localizer = Localizer(model, motion="none", seed=5)
    for row, image in zip(rows[:4], queries.images(), strict=False):
        assert localizer.update(image).place == int(row["place"])
    again = train("w/reference_events.h5", config=model.config)
    assert again.places == len(open_traverse("w/reference_events.h5", events=model.config.events))


def test_the_truth_is_where_the_vehicle_is(there: Path) -> None:
    for kind, speed in (("reference", 10.0), ("query", 15.0)):
        rows = np.loadtxt(f"w/{kind}_positions.csv", delimiter=",", skiprows=1)
        along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(rows[:, 1:], axis=0).T))])
        assert along[-1] == pytest.approx(100, abs=0.5)
        assert np.diff(along)[:-1].mean() * 10 == pytest.approx(speed, rel=0.1)
        last = [part.t[-1] for part in open_events(Path(f"w/{kind}_events.h5")).events()][-1]
        assert last / 1e6 == pytest.approx(rows[-1, 0] - rows[0, 0], abs=0.1)


@pytest.mark.slow
def test_equal_seeds_write_equal_files_and_npz_holds_the_same_events(there: Path) -> None:
    run("synth", "again", "--places", 5, "--events", "npz", "--query-condition", "rain", "--query-speed", 15)
    first, second = (
        [part for part in open_events(Path(name)).events()] for name in ("w/query_events.h5", "again/query_events.npz")
    )
    start = np.int64(1_736_942_400_000_000)
    for name, offset in (("t", start), ("x", 0), ("y", 0)):
        one, other = (np.concatenate([getattr(part, name) for part in parts]) for parts in (first, second))
        np.testing.assert_array_equal(one + offset, other)
    for table in ("reference_positions.csv", "query_positions.csv"):
        assert Path("w", table).read_bytes() == Path("again", table).read_bytes()


def test_what_cannot_be_is_told_in_one_line(there: Path) -> None:
    train_it = ("train", "-o", "n.lvpr")
    assert "both say how long" in fails(*train_it, "w/query_events.h5", "--window-ms", 5, "--window-events", 5, code=2)
    events = made()
    back = dsec(there / "back.h5", events._replace(t=events.t[::-1]))
    assert "back.h5: event 1 goes back" in fails(*train_it, back)
    short = aedat4(there / "short.aedat4", Made(*(values[:9] for values in events[:4]), events.size))
    assert "shorter than half a window" in fails(*train_it, short, "--window-events", 1000)
    (there / "cut.h5").write_bytes((there / "w/query_events.h5").read_bytes()[:5000])
    assert "cut.h5" in fails("query", "m.lvpr", "cut.h5")
    assert not Path("n.lvpr").exists()


def test_an_earlier_drive_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    run("synth", tmp_path / "w", "--places", 2)
    run("synth", tmp_path / "w", "--places", 2, "--events", "--metres", 5)
    assert sorted(path.name for path in (tmp_path / "w").iterdir()) == [
        "query_events.h5", "query_positions.csv", "reference_events.h5", "reference_positions.csv",
    ]  # fmt: skip
    (tmp_path / "w" / "mine.txt").write_text("mine")
    assert "holds something else (mine.txt)" in fails("synth", tmp_path / "w", "--places", 2, "--events")


def test_events_on_standard_input_are_watched(there: Path) -> None:
    events = next(iter(open_events(Path("w/query_events.h5")).events()))
    rows = zip(events.t[:60_000].tolist(), events.x.tolist(), events.y.tolist(), strict=False)
    data = b"".join(EVENT.pack(t, x, y, True) for t, x, y in rows)
    command = [sys.executable, "-m", "lava_vpr", "watch", "m.lvpr", "events:128x64", *EVERY]
    result = children.run(command, input=data, capture_output=True, check=True)
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(lines) > 2
    assert [line["query_name"] for line in lines[:2]] == ["window 000000", "window 000001"]
    assert lines[0]["time"] == pytest.approx(0.075, abs=1e-3)
    assert lines[1]["probability"] is not None


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8, 0.9, 1.0])
@pytest.mark.parametrize("seed", range(6))
def test_saturation_is_a_quantile_of_the_pixels_that_are_not_0(share: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = np.minimum(rng.poisson(rng.gamma(0.5, 8, (20, 30))), 255).astype(np.uint8)
    above = sorted(level for level in image.reshape(-1).tolist() if level)
    top = next(level for level in range(1, 256) if sum(one <= level for one in above) >= share * len(above))
    wanted = [[min(level, top) * 255 // top for level in row] for row in image.tolist()]
    assert saturated(image, share).tolist() == wanted
    coloured = np.repeat(image[:, :, None], 3, axis=2)
    assert saturated(coloured, share).tolist() == wanted


def test_an_image_without_events_stays_dark() -> None:
    assert not saturated(np.zeros((8, 8), np.uint8), 0.8).any()
    assert not activity_of(np.zeros((16, 16), np.uint8), EncoderConfig(kind="events")).any()


def test_the_input_is_orientation_channels_of_the_saturated_image() -> None:
    image = np.random.default_rng(0).integers(0, 40, (30, 40)).astype(np.uint8) ** 2 // 9
    encoder = EncoderConfig(kind="events", saturation=0.7)
    wanted = activity_of(saturated(image, 0.7), EncoderConfig(kind="orientation"))
    np.testing.assert_array_equal(activity_of(image, encoder), wanted)
    assert encoder.inputs == EncoderConfig().inputs


def test_settings_of_events_leave_what_is_said() -> None:
    base = preset("loihi")
    config = for_events(base)
    assert (config.encoder.kind, config.views.shifts, config.decoder.default) == ("events", 3, "standard")
    said = update(base, {"encoder": {"kind": "onoff"}, "views": {"shifts": 5}, "decoder": {"default": "weighted"}})
    assert for_events(said) == said
    assert for_events(preset("paper")) == preset("paper")
    assert for_events(preset("fast")).network == preset("fast").network


def test_recordings_are_learned_so_and_options_win(tmp_path: Path) -> None:
    path = dsec(tmp_path / "a.h5", made(6000, 6.0))
    (tmp_path / "quick.toml").write_text("[network]\nsteps = 32\n[learning]\nsteps = 20\nepochs = 2\n")
    words = ("train", path, "--config", tmp_path / "quick.toml", "-o", tmp_path / "m.lvpr")
    for options, kind, views in (((), "events", 3), (("--views", "1", "--input", "orientation"), "orientation", 1)):
        run(*words, *options)
        config = load(tmp_path / "m.lvpr").config
        assert (config.encoder.kind, config.views.shifts, config.decoder.default) == (kind, views, "standard")
    assert train(path).config == for_events(preset("loihi"))
    frames = list(open_traverse(path).images())
    assert train(frames).config.encoder.kind == "orientation"  # who knows what images in memory are


@pytest.mark.data
def test_the_example_of_lens_is_recognised_better_than_by_sad(data_root: Path) -> None:
    folder = data_root / "data" / "lens_example"
    own = np.load(folder / "ground_truth.npy").astype(bool)
    shown = [np.roll(np.pad(own, ((0, 0), (3, 3))), off, axis=1)[:, 3:-3] for off in range(-3, 4)]
    right = np.logical_or.reduce(shown)
    config = for_events(preset("loihi"))
    learned = encode_views(open_traverse(folder / "reference"), config.encoder, config.views.views, Keep.ALL)
    queries = encode_traverse(open_traverse(folder / "query"), config.encoder, Keep.ALL)
    found: dict[str, Metrics] = recognise(
        train_encoded(list(learned), config), queries, right, Comparison(rivals=("sad",), keep_scores=False)
    ).metrics
    ours, sad = found["standard"], found["sad"]
    assert (sad.recall_at_1, round(sad.recall_at_100_precision, 2)) == (
        0.84,
        0.61,
    )  # in three views; .74 and .46 in one
    assert ours.recall_at_1 >= 0.88
    assert ours.recall_at_100_precision >= 0.7
