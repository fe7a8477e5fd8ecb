"""Timings, memory and energy of backends: what is told is what happened, and what is absent is said."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.common import children
from support.common.imagefiles import write_images
from support.common.small_models import encoded, small_model

from lava_vpr.backends import registry as backends
from lava_vpr.backends.interface import Presentations
from lava_vpr.bench.measure import child, rapl, timing as measure
from lava_vpr.bench.measure.timing import measure_encoding, measure_localizer
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import LavaRunError
from lava_vpr.localizer import Localizer
from lava_vpr.matching.decoders import DECODERS, best
from lava_vpr.matching.equations import contrast
from lava_vpr.model import decode
from lava_vpr.recognition import count_query_spikes
from lava_vpr.traverse import open_traverse

SPAN = 1_000_000


def domain(root: Path, folder: str, name: str, energy: int = 0) -> Path:
    """A counter as the kernel shows it."""
    path = root / folder
    path.mkdir(parents=True)
    for file, value in (("name", name), ("energy_uj", energy), ("max_energy_range_uj", SPAN)):
        (path / file).write_text(f"{value}\n")
    return path


def machine(root: Path) -> dict[str, Path]:
    """Two packages, one with memory chips, and what must not be counted."""
    made = {
        "first": domain(root, "intel-rapl:0", "package-0", 999_900),
        "dram": domain(root, "intel-rapl:0:1", "dram", 10),
        "core": domain(root, "intel-rapl:0:0", "core", 5),
        "second": domain(root, "intel-rapl:1", "package-1", 100),
        "psys": domain(root, "intel-rapl:2", "psys", 7),
        "mmio": domain(root, "intel-rapl-mmio:0", "package-0", 7),
    }
    (root / "intel-rapl").mkdir()
    return made


def add(folder: Path, energy: int) -> None:
    """Let a counter count, beginning again after its span."""
    path, later = folder / "energy_uj", folder / "later"
    later.write_text(f"{(int(path.read_text()) + energy) % SPAN}\n")
    later.replace(path)  # a reader meanwhile sees the old or the new number, never half of one


# Energy


def test_packages_and_their_memory_are_counted_and_nothing_twice(tmp_path: Path) -> None:
    machine(tmp_path)
    names = [(counter.folder.name, counter.name) for counter in rapl.counters(tmp_path)]
    assert names == [
        ("intel-rapl:0", "package-0"),
        ("intel-rapl:0:1", "package-0 dram"),
        ("intel-rapl:1", "package-1"),
    ]


def test_a_counter_that_begins_again(tmp_path: Path) -> None:
    parts = machine(tmp_path)
    counters = rapl.counters(tmp_path)
    before = [counter.read() for counter in counters]
    for name, energy in (("first", 250), ("dram", 30), ("second", 400), ("core", 999), ("psys", 999), ("mmio", 999)):
        add(parts[name], energy)
    after = [counter.read() for counter in counters]
    assert after[0] < before[0]  # it did
    assert rapl.joules(counters, before, after) == pytest.approx(680e-6)


def read_before_and_after(meter: rapl.Meter) -> float:
    """A moment before and after which the counters are read, with nothing spent in between."""

    def wait() -> None:
        end = len(meter._at) + 2
        while len(meter._at) < end:
            time.sleep(0.001)

    wait()
    moment = time.monotonic()
    wait()
    return moment


def test_a_meter_finds_the_energy_of_a_span_again(tmp_path: Path) -> None:
    """What is spent before and after does not count; a counter that begins again many times does not matter."""
    parts = machine(tmp_path)
    spent, stamps = 400_000, []
    with rapl.Meter(tmp_path, period=0.002) as meter:
        for phase in range(3):
            stamps.append(read_before_and_after(meter))
            for _ in range(4):
                add(parts["first"], spent if phase == 1 else 7)
                read_before_and_after(meter)
            stamps.append(read_before_and_after(meter))
    assert meter.joules(stamps[2], stamps[3]) == pytest.approx(4 * spent * 1e-6, rel=1e-3)
    assert meter.joules(stamps[0], stamps[1]) == pytest.approx(28e-6, rel=1e-3)
    assert meter.sources == "package-0, package-0 dram, package-1"
    assert meter.joules(stamps[0] - 10, stamps[1]) is None
    assert meter.reason == "the counters were not read all the while"


def _nothing(root: Path) -> str:
    return f"{root} is missing: this machine (or virtual machine) shows no RAPL counters"


def _empty(root: Path) -> str:
    root.mkdir()
    return f"{root} lists no RAPL package: the processor has none, or its driver (intel_rapl) is absent"


def _locked(root: Path) -> str:
    path = domain(root, "intel-rapl:0", "package-0") / "energy_uj"
    return f"{path} may be read by root only; run as root, or: sudo chmod a+r {path}"


def _garbled(root: Path) -> str:
    path = domain(root, "intel-rapl:0", "package-0") / "energy_uj"
    path.write_text("none\n")
    return f"{path} holds 'none', no number"


@pytest.mark.parametrize("prepare", [_nothing, _empty, _locked, _garbled])
def test_why_there_is_no_energy(
    prepare: Callable[[Path], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "powercap"
    reason = prepare(root)
    if prepare is _locked:  # root, who runs tests in containers, may read everything
        plain = Path.read_text

        def read(path: Path, *args: str, **kwargs: str) -> str:
            if path.name == "energy_uj":
                raise PermissionError(13, "Permission denied", str(path))
            return plain(path, *args, **kwargs)

        monkeypatch.setattr(Path, "read_text", read)
    with pytest.raises(rapl.NoRaplError) as caught:
        rapl.counters(root)
    assert str(caught.value) == reason
    with rapl.Meter(root) as meter:
        pass
    assert meter.joules(0.0, 1.0) is None
    assert meter.reason == reason
    assert rapl.idle_watts(0.0, root) is None


# Memory


def test_the_peak_is_that_of_the_process_itself() -> None:
    """A child that holds 120 MB for a moment says so; one that holds nothing does not take over what we held."""
    held = 120_000_000
    ballast = np.ones(held // 8)
    code = "import numpy as np; from lava_vpr.isolated import child; {}; print(child.own_peak())"
    peaks = []
    for does in (f"x = np.ones({held // 8}); del x", "pass"):
        run = children.run([sys.executable, "-c", code.format(does)], capture_output=True, text=True, check=True)
        peaks.append(int(run.stdout))
    assert ballast.nbytes == held
    assert peaks[0] > held
    assert peaks[0] - peaks[1] == pytest.approx(held, rel=0.1)


def test_what_a_family_shares_is_counted_once() -> None:
    held = 200_000_000
    code = (
        "import os, time, numpy as np; from lava_vpr.isolated import child; x = np.ones({size});"
        "pids = [os.fork() for _ in range(1)]\n"
        "if 0 in pids: time.sleep(30); os._exit(0)\n"
        "time.sleep(0.2); print(len(child.family()), child.held_by_family())\n"
        "os.kill(pids[0], 9); os.waitpid(pids[0], 0)"
    )
    run = children.run([sys.executable, "-c", code.format(size=held // 8)], capture_output=True, text=True, check=True)
    processes, together = map(int, run.stdout.split())
    assert processes == 2
    assert held < together < 1.7 * held


# Timing


def test_the_host_is_timed_answering_what_it_always_answers() -> None:
    model, queries = small_model(), encoded(noise=0.4)
    rates = query_rates(queries.activity, model.config)
    answer = child.host_answer(model, model.config.seed)
    wanted = best(decode(model, count_query_spikes(model, queries)[0], model.config.decoder.default))
    assert np.array_equal(answer(rates), wanted)
    assert np.array_equal(child.batch(answer, rates, 3), wanted)
    assert np.array_equal(child.batch(answer, np.tile(rates, (3, 1)), 2), np.tile(wanted, 3))
    assert [int(answer(rates[k : k + 1])[0]) for k in range(len(rates))] == wanted.tolist()


@pytest.mark.parametrize("name", DECODERS)
def test_a_decoder_that_is_kept_decodes_alike(name: str) -> None:
    rng = np.random.default_rng(0)
    model = replace(small_model(), responses=rng.integers(0, 9, small_model().responses.shape).astype(np.int32))
    counts = rng.integers(0, 4, (200, model.neurons)).astype(np.int32)
    chosen = replace(model, config=replace(model.config, decoder=replace(model.config.decoder, default=name)))
    wanted = best(decode(model, counts, name))
    assert np.array_equal(child.decoder_of(chosen)(counts), wanted)
    assert name == "contrast" or not np.array_equal(wanted, best(contrast(model.responses)(counts)))


def test_single_queries_are_told_one_by_one() -> None:
    def answer(rates: np.ndarray) -> np.ndarray:
        seen.append(rates.tolist())
        time.sleep(0.01 if rates[0, 0] == 6 else 0.0)
        return rates[:, 0]

    seen: list[list[list[int]]] = []
    rates = np.array([[5, 1], [6, 2]])
    taken = child.singles(answer, rates, 4, 60.0)
    assert seen == [[[5, 1]], [[6, 2]], [[5, 1]], [[6, 2]]]
    assert len(taken) == 4
    assert taken[1] >= 10 > taken[0]
    assert len(child.singles(answer, rates, 1000, 0.0)) == 1


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Little is timed."""
    for name, value in (("SINGLES", 20), ("FILL", 0.01)):
        monkeypatch.setattr(measure, name, value)
    fused = replace(backends.BACKENDS["lava-fused"], batch=200)
    monkeypatch.setitem(backends.BACKENDS._rows, fused.name, fused)
    monkeypatch.setattr(rapl.idle_watts, "__defaults__", (0.1, rapl.ROOT))


def asked(noise: float = 0.0) -> QuerySet:
    """Queries to the small model."""
    return QuerySet.of(small_model(), encoded(noise=noise))


def check(found: measure.Measured, queries: int, singles: int) -> None:
    """Figures that fit each other."""
    assert found.absent == ""
    assert found.queries == queries
    assert len(found.milliseconds) == singles
    assert found.milliseconds == tuple(sorted(found.milliseconds))
    assert all(x > 0 for x in found.milliseconds)
    assert found.queries_per_second > 0.2 * 1e3 / np.median(found.milliseconds)
    assert 2e7 < found.peak_bytes < 1e9
    assert bool(found.no_energy) != (found.joules_per_query is not None)


@pytest.mark.usefixtures("brief")
def test_the_host_measured_in_a_process_of_its_own(tmp_path: Path) -> None:
    parts, over = machine(tmp_path), threading.Event()

    def spend() -> None:
        while not over.wait(0.005):
            add(parts["first"], 1000)
            add(parts["second"], 1000)

    thread = threading.Thread(target=spend)
    thread.start()
    try:
        found = measure.measure(asked(noise=0.4), "host", rounds=2, rapl_root=tmp_path)
    finally:
        over.set()
        thread.join(60)
    check(found, 8, 20)
    watts = found.joules_per_query * found.queries_per_second
    assert 0.01 < watts < 4  # 2 mJ in 5 ms or more
    assert "package-0, package-0 dram, package-1, which draw" in found.what


@pytest.mark.slow
@pytest.mark.usefixtures("brief")
def test_a_bundle_is_measured() -> None:
    found = measure.measure(asked(noise=0.4), "bundle", limit=3, rounds=5, rapl_root=Path("/none"))
    check(found, 3, 20)
    assert found.no_energy == "/none is missing: this machine (or virtual machine) shows no RAPL counters"


@pytest.mark.lava
@pytest.mark.slow
@pytest.mark.usefixtures("brief")
@pytest.mark.parametrize("backend", ["lava-fixed", "lava-fused", "lava-library", "lava-float"])
def test_lava_is_measured_without_its_start(backend: str) -> None:
    found = measure.measure(asked(noise=0.4), backend, limit=4, rapl_root=Path("/none"))
    check(found, 4, 4)
    start = float(found.what.split("Lava's start, ")[1].split(" s")[0])
    assert max(found.milliseconds) < 1e3 * start


@pytest.mark.lava
@pytest.mark.slow
def test_lava_counts_the_same_when_it_is_timed() -> None:
    model, queries = small_model(), encoded(noise=0.4)
    rates = query_rates(queries.activity, model.config)[:3]
    fused = backends.get("lava-fused")
    counts, runs, held = fused.timed(model, Presentations(rates, 0), single=True)
    assert np.array_equal(counts, count_query_spikes(model, queries, seed=0)[0][:3])
    assert runs[:, 0].tolist() == [1, 1, 1]
    assert (runs[:, 2] > runs[:, 1]).all()
    assert (runs[1:, 1] >= runs[:-1, 2]).all()
    assert held > 2e7


def test_the_stage_before(tmp_path: Path) -> None:
    write_images(tmp_path / "i", 5)
    found = measure_encoding(open_traverse(tmp_path / "i"), small_model().config, limit=4)
    assert (found.name, found.queries, len(found.milliseconds)) == ("encoding", 4, 4)
    assert found.queries_per_second == pytest.approx(1e3 / np.mean(found.milliseconds))


def test_the_public_path_is_timed_image_by_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_images(tmp_path / "i", 5)
    asked, update = [], Localizer.update
    monkeypatch.setattr(Localizer, "update", lambda self, image: asked.append(image.shape) or update(self, image))
    found = measure_localizer(open_traverse(tmp_path / "i"), small_model(), limit=4)
    assert (found.name, found.queries, len(found.milliseconds)) == ("localizer", 4, 4)
    assert len(asked) == 5  # one before the clock runs


# What is absent


@pytest.mark.lava
@pytest.mark.parametrize("backend", ["loihi2", "kapoho-bay"])
def test_no_board(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SLURM", "NXSDKHOST", "KAPOHOBAY", "NXSDK_PYTHON"):
        monkeypatch.delenv(name, raising=False)
    found = measure.measure(asked(), backend)
    assert found.absent.startswith("no board here: ")
    assert "is not installed" in found.absent
    assert (found.queries, found.milliseconds, found.queries_per_second) == (0, (), None)


def test_what_a_backend_cannot_run_is_said() -> None:
    nothing = np.zeros((1, 1), np.float32)
    paper = replace(small_model(), network=ConductanceState(nothing, nothing[0], nothing))
    found = measure.measure(QuerySet.of(paper, encoded()), "bundle")
    assert found.absent.startswith("bundle needs an integer network, but preset paper is the float conductance model")


def test_a_run_that_fails_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*args: object, **kwargs: object) -> None:
        raise LavaRunError("out of memory; use fewer queries")

    monkeypatch.setattr(measure, "run_isolated", fails)
    monkeypatch.setattr(rapl, "idle_watts", lambda root: None)
    found = measure.measure(asked(), "host", rapl_root=Path("/none"))
    assert found.absent == "out of memory; use fewer queries"
    no_queries = measure.measure(asked(), "host", limit=0)
    assert no_queries.absent == "there are no queries"
