"""A changed file given to the program: it reads and is equal when written again, or costs one clear line.

    PYTHONPATH=tests .venv/bin/python -m support.fuzz.run [--count 10000] [--seed 0] [--first 0] [--show 20] [--record]

changes honest files at random, gives them to the program, and counts what becomes of them. Prints outcomes by format,
and every failure with its number; ``--first NUMBER --count 1`` repeats one alone. The exit code is 1 if there is a
failure. A case that takes more than `CPU_SECONDS` of the processor, or that ends the process, ends the run: the last
number in ``--log`` is its own. One that takes more than `MEMORY` is a MemoryError.

Used by storage.
"""

from __future__ import annotations

import argparse
import collections
import faulthandler
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomli
from click.testing import CliRunner
from support.fuzz import changes, corpus, damage
from support.fuzz.changes import SPECIAL, Files
from support.fuzz.corpus import IMAGE_LISTS, PLACES, SETTINGS, Corpus
from support.fuzz.damage import OTHER, WHOLE, wrong_with

from benchmarks import figures
from lava_vpr.backends.asking import open_model
from lava_vpr.cli import main as command
from lava_vpr.configfile import read_toml, to_dict, to_toml
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import LavaVprError
from lava_vpr.model import Model, content, load, save
from lava_vpr.positions.gpx import read_gpx
from lava_vpr.positions.track import read_table
from lava_vpr.show.table import Table
from lava_vpr.storage import container
from lava_vpr.storage.limits import LIMITS, variable
from lava_vpr.training.checkpoint import Checkpoint
from lava_vpr.training.loop import split, train
from lava_vpr.training.trainers import rule_of
from lava_vpr.traverse import open_traverse
from lava_vpr.truth.alignment import read_ground_truth

CPU_SECONDS = 5.0
"""Processor time of one case, whatever else the machine does."""
MEMORY = 1 << 30
"""What a case may take beside what the process has at its start."""
LOWERED = 1 << 26
"""Most of every limit in bytes, so that `MEMORY` is far above what limits allow."""

REFUSED, SOUND = "refused", "read and equal when written again"
FINE = (REFUSED, SOUND, WHOLE, OTHER)
"""What may become of a file."""
SHARES = {"model": 12, "bundle": 10, "checkpoint": 5, "settings": 4, "list": 5}
SHARES |= {"vectors": 14, "events": 16, "image": 12, "video": 8, "bag": 6, "network": 4, "times": 4}
"""Cases of each format, in percent."""
COMMANDED = 0.1
"""Share of the cases with which a command is tried, too."""


class UnequalError(Exception):
    """What was read is not what the file says, or another when it is written and read again."""


@dataclass(frozen=True)
class Case:
    """A changed file or folder, decided by seed and number.

    Attributes:
        format: A key of `SHARES`.
        honest: Name of the file that was changed.
        files: Contents by name; a single file, or those of a bundle.
        draw: In [0, 1); decides which command is tried with it, if any.
        damage: What happened to it, where `damage` decides that.
    """

    format: str
    honest: str
    files: Files = field(repr=False)
    draw: float = 1.0
    damage: str = ""


def honest(corpus: Corpus) -> list[Case]:
    """Every honest file as a case that changes nothing; a command is tried with it, too."""
    return [
        Case(kind, name, files, float(kind in damage.READERS))
        for kind, named in corpus.files.items()
        for name, files in named.items()
    ]


def unsound(corpus: Corpus) -> Iterator[str]:
    """What is told of each honest file that is not read, or is another when it is written again."""
    for case in honest(corpus):
        kind, told = tried(case, corpus)
        if (kind, told) != (WHOLE if case.format in damage.READERS else SOUND, ""):
            yield f"{kind}: honest, {case}\n    {told.strip()}"


def made(corpus: Corpus, seed: int, number: int) -> Case:
    """Case ``number`` of ``seed``."""
    rng = random.Random(f"{seed}/{number}")
    kind = rng.choices(list(SHARES), list(SHARES.values()))[0]
    name = rng.choice(sorted(corpus.files[kind]))
    files, draw = corpus.files[kind][name], rng.random()
    others = {name: next(iter(other.values())) for name, other in corpus.files[kind].items()}
    if kind == "bundle":
        return Case(kind, name, changes.bundle(rng, files, corpus.files[kind]), draw)
    ((file, data),) = files.items()
    if kind in damage.READERS:
        what, data = damage.changed(rng, file, data)
        return Case(kind, name, {file: data}, damage=what)
    if kind in ("model", "checkpoint"):
        special = SPECIAL + rng.choice([b"fifo", b"folder", b"missing", b"link /dev/zero", b"link /dev/null"])
        data = special if rng.random() < 0.01 else changes.container(rng, data, others)
    elif file.endswith(".npy"):
        data = changes.array(rng, changes.held(data))
    elif file.endswith(".json") and rng.random() < 0.7:
        data = changes.value(rng, json.loads(data))
    else:
        data = changes.text(rng, data)
    return Case(kind, name, {file: data}, draw)


def written(case: Case, folder: Path) -> Path:
    """Write the files of ``case`` below ``folder``; the file, or the folder of a bundle."""
    root = folder / "bundle" if case.format == "bundle" else folder
    for name, data in case.files.items():
        target = root / name
        if case.format == "bundle" and not os.path.realpath(target).startswith(f"{os.path.realpath(root)}/"):
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        kind, _, argument = data.removeprefix(SPECIAL).partition(b" ") if data.startswith(SPECIAL) else (data, b"", b"")
        if not data.startswith(SPECIAL):
            target.write_bytes(data)
        elif kind == b"fifo":
            os.mkfifo(target)
        elif kind == b"folder":
            target.mkdir()
        elif kind == b"link":
            target.symlink_to(argument.decode() if argument.startswith(b"/") else target.name)
    return root if case.format == "bundle" else folder / next(iter(case.files))


def equal(found: object, wanted: object, what: str) -> None:
    """Refuse what is another value, of another type (but a whole number as a float) or shape."""
    if isinstance(wanted, np.ndarray):
        same = isinstance(found, np.ndarray) and found.shape == wanted.shape and np.array_equal(found, wanted)
        same = same and (found.dtype == wanted.dtype or what == "responses")  # kept in 16 bits where they fit
    elif isinstance(wanted, dict) and isinstance(found, dict):
        for key, value in wanted.items():  # what the file does not say is the preset's
            equal(found.get(key), value, f"{what}.{key}")
        return
    else:
        same = found == wanted and (type(found) is type(wanted) or (type(found), type(wanted)) == (float, int))
    if not same:
        raise UnequalError(f"{what}: {found!r:.60}, not {wanted!r:.60}")


def contents(model: Model) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a file keeps of ``model``, but for the version; of a bundle's also the network read from its board."""
    header, arrays = content(model)
    if isinstance(model.network, FixedNetwork):
        arrays |= {"network.weights": model.network.weights, "network.bias": model.network.bias}
    return {key: value for key, value in header.items() if key != "version"}, arrays


def equal_models(found: Model, header: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Refuse a model that is not of this header and these arrays, all of them."""
    own, held = contents(found)
    equal(own, {key: value for key, value in header.items() if key != "version"}, "header")
    equal(sorted(held), sorted(arrays), "arrays")
    for name, array in arrays.items():
        equal(held[name], array, name)


def written_again(model: Model, path: Path) -> None:
    """Refuse a model that is another when it is written beside ``path`` and read again."""
    save(model, path.with_name("again.lvpr"))
    equal_models(load(path.with_name("again.lvpr")), *contents(model))


MEASURED = {"responses", "calibration"}
"""What deployment measures again, by the network that it deploys."""


def read_model(case: Case, corpus: Corpus, path: Path) -> None:
    """A model file: what it says, nothing else, and the same when it is written again."""
    model = open_model(path)
    equal_models(model, *container.load(path, "model"))
    written_again(model, path)


def read_bundle(case: Case, corpus: Corpus, path: Path) -> None:
    """A bundle, and the network in it that learns, if there is one: the same when it is deployed again."""
    opened, model = bundle_folder.load(path), open_model(path)
    written_again(model, path)
    again = path.with_name("again")
    deploy(model, BOARDS[opened.manifest["target"]], again, picture=False)
    header, arrays = contents(model)
    found = open_model(again)
    for name in MEASURED & set(arrays):
        arrays[name] = contents(found)[1][name]
    equal_models(found, header, arrays)


def read_checkpoint(case: Case, corpus: Corpus, path: Path) -> None:
    """A checkpoint: its state in the trainers, and a model that comes of it, the same when it is written again."""
    config, references = SETTINGS[case.honest], corpus.references[case.honest]
    kept = Checkpoint(path, corpus.fingerprint(case.honest))
    none = np.zeros((0, 0), np.float32)
    trainers = [
        rule_of(config).trainer(config, part, number, none) for number, part in enumerate(split(PLACES, config))
    ]
    kept.load(trainers, config.learning.epochs, len(references))
    held = container.load(path, "checkpoint")[1]
    state = {f"{n}.{name}": array for n in kept.epochs for name, array in trainers[n].state().items()}
    equal(sorted(state), sorted(held), "arrays")
    for name, array in held.items():
        equal(state[name], array, name)
    written_again(train(references, config, checkpoint=path, resume=True), path)


def read_settings(case: Case, corpus: Corpus, path: Path) -> None:
    """Settings in TOML: what the file says, for the rest a preset, and the same when they are written again."""
    config = read_toml(path)
    equal(to_dict(config), tomli.loads(path.read_text("utf-8-sig")), "settings")
    path.with_name("again.toml").write_text(to_toml(config), "utf-8")
    equal(to_dict(read_toml(path.with_name("again.toml"))), to_dict(config), "settings")


def read_list(case: Case, corpus: Corpus, path: Path) -> None:
    """A list of images, a ground truth or positions: the same when they are written again, as plainly as can be."""
    again = path.with_name("again.csv")
    if case.honest.startswith("truth"):
        numbers = np.arange(PLACES, dtype=np.int64)
        truth = read_ground_truth(path, numbers, numbers)
        np.save(again.with_suffix(".npy"), truth)
        equal(read_ground_truth(again.with_suffix(".npy"), numbers, numbers), truth, "truth")
    elif case.honest in IMAGE_LISTS:
        paths = [str(image) for image in open_traverse(path).paths]
        again.with_suffix(".txt").write_text("".join(f"{os.path.abspath(image)}\n" for image in paths), "utf-8")
        found = open_traverse(again.with_suffix(".txt")).paths
        equal([str(image) for image in found], [os.path.abspath(image) for image in paths], "list")
    else:
        track = read_gpx(path) if case.honest.endswith(".gpx") else read_table(path)
        names = "lat,lon" if track.positions.frame == "latlon" else "x,y"
        rows = "".join(f"{a!r},{b!r}\n" for a, b in track.positions.values.tolist())
        again.write_text(f"{names}\n{rows}", "utf-8")
        equal(read_table(again).positions.values, track.positions.values, "positions")


def read_damaged(case: Case, corpus: Corpus, path: Path) -> str:
    """A file that another program wrote: what becomes of it."""
    return damage.judged(case.format, path, corpus.files[case.format][case.honest][path.name], case.damage)


READERS: dict[str, Callable[[Case, Corpus, Path], str | None]] = {
    "model": read_model,
    "bundle": read_bundle,
    "checkpoint": read_checkpoint,
    "settings": read_settings,
    "list": read_list,
    **dict.fromkeys(damage.READERS, read_damaged),
}


def tried(case: Case, corpus: Corpus) -> tuple[str, str]:
    """What becomes of ``case``: `REFUSED`, `SOUND` or what it does that no file may, and what is to be told of it."""
    folder, before = corpus.folder / "work", os.getcwd()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    os.chdir(folder)
    try:
        path = written(case, folder)
        try:
            outcome = READERS[case.format](case, corpus, path) or SOUND, ""
        except LavaVprError as error:
            wrong = wrong_with(str(error), path)
            outcome = (wrong, str(error)[:600]) if wrong else (REFUSED, str(error))
        told = _commanded(case, path, outcome) if case.draw < COMMANDED and outcome[0] in (REFUSED, SOUND) else ""
        return ("BAD COMMAND", told) if told else outcome
    except Exception as error:
        return type(error).__name__, traceback.format_exc()
    finally:
        os.chdir(before)


def _commanded(case: Case, path: Path, outcome: tuple[str, str]) -> str:
    """What a command does otherwise than the reader; empty if nothing."""
    words = list(_commands(case, str(path)))[int(case.draw * 1000) % 3].split()
    result = CliRunner().invoke(command, words)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        return "".join(traceback.format_exception(*result.exc_info))
    beside = ("note: ", "warning: ", "resuming from ")
    lines = [line for line in result.stderr.splitlines() if not line.startswith(beside)]
    allowed = (1,) if outcome[0] == REFUSED else (0, 1)
    fits = result.exit_code in allowed and len(lines) == (result.exit_code == 1)
    head = "lava-vpr: error: "
    fits = fits and all(line.startswith(head) and not wrong_with(line[len(head) :], None) for line in lines)
    return "" if fits else f"lava-vpr {' '.join(words)}: {result.exit_code}, {result.stderr[:600]!r}; {outcome}"


def _commands(case: Case, file: str) -> Iterator[str]:
    """Commands that read the file."""
    sources = "../reference" if case.honest == "paper" else "../reference ../second"
    if case.format == "checkpoint":
        out = file.removesuffix(".checkpoint")
        yield from [f"train {sources} -o {out} --config ../{case.honest}.toml --resume"] * 3
    elif case.format == "settings":
        yield from [f"train ../missing -o x.lvpr --config {file}"] * 3
    elif case.format == "list" and case.honest in IMAGE_LISTS:
        yield from [f"query ../float.lvpr {file} -o matches.csv"] * 3
    elif case.format == "list":
        given = f"--gt {file}" if case.honest.startswith("truth") else f"--positions {file} {file} --radius 5"
        yield from [f"eval ../float.lvpr ../query {given}"] * 3
    else:
        yield f"eval {file} ../query"
        yield f"query {file} ../query -o matches.csv"
        yield f"verify {file} ../query --backend bundle --limit 2"


def guard() -> None:
    """Lower the program's limits in bytes, and bound the memory of this process."""
    for name, limit in LIMITS.items():
        if limit.unit == "bytes":
            os.environ[variable(name)] = str(min(limit.default, LOWERED))
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.disable()
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", DeprecationWarning)


def main(words: list[str] | None = None) -> int:
    """Run the command; its exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    for name, default in (("--count", 10_000), ("--seed", 0), ("--first", 0), ("--show", 20)):
        parser.add_argument(name, type=int, default=default)
    parser.add_argument("--log", type=Path, default=Path(os.devnull), help="File that gets the number of each case.")
    parser.add_argument("--record", action="store_true", help="Take the table into docs/results/fuzzed.json.")
    asked = parser.parse_args(words)
    cv2.setNumThreads(0)
    counts = collections.Counter[tuple[str, str]]()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder, asked.log.open("w") as log:
        honest_files = corpus.make(Path(folder))
        wrong = list(unsound(honest_files))  # compiles what they need, before there are guards
        print(*wrong, sep="\n", flush=True)
        guard()
        for number in range(asked.first, asked.first + asked.count):
            case = made(honest_files, asked.seed, number)
            print(number, case.format, case.honest, file=log, flush=True)
            signal.setitimer(signal.ITIMER_PROF, CPU_SECONDS)  # SIGPROF ends the process
            kind, told = tried(case, honest_files)
            signal.setitimer(signal.ITIMER_PROF, 0)
            counts[case.format, kind] += 1
            if kind not in FINE and asked.show:
                asked.show -= 1
                print(f"{kind}: seed {asked.seed}, number {number}, {case}\n    {told.strip()}", flush=True)
    kinds = [*FINE, *sorted({kind for _, kind in counts} - {*FINE})]
    columns, rows = ["format", *kinds], [[f, *(str(counts[f, kind]) for kind in kinds)] for f in SHARES]
    print(Table(columns, rows).markdown())
    if asked.record and ((asked.count, asked.seed, asked.first) != (20_000, 0, 0) or len(kinds) > len(FINE)):
        print("not recorded: the record is of --count 20000 --seed 0 without a failure")
    elif asked.record:
        figures.write("fuzzed", replace(figures.read("fuzzed"), columns=columns, rows=rows))
    return int(bool(wrong) or len(kinds) > len(FINE))


if __name__ == "__main__":
    sys.exit(main())
