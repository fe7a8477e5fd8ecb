"""Rows of other packages that fail while they are used cost a line; what the others give is what it is."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.commands import fails, figures, run
from support.common.plugins import READER, Install
from support.common.small_models import encoded, small_model

from lava_vpr.backends.verification import verify
from lava_vpr.cli import main
from lava_vpr.configfile import update
from lava_vpr.model import load, save
from lava_vpr.readers import READERS
from lava_vpr.rows import guarded
from lava_vpr.traverse import open_traverse

FAILING = """
from dataclasses import replace
from lava_vpr.backends.interface import BackendRow, HostBackend
from lava_vpr.configfile import update
from lava_vpr.errors import ConfigError
from lava_vpr.images.sampling import Sample
from lava_vpr.inputs.encoder import Input
from lava_vpr.matching.decoders import DECODERS, Decoder, in_every_variant, margin
from lava_vpr.readers import Found, Reader

def fails(*_):
    raise RuntimeError("out\\nof order")

def leaves(*_):
    raise SystemExit(3)

def refuses(*_):
    raise ConfigError("too few places")

class Counter:
    "Counts nothing."
    count_spikes = trains = fails

def drives():
    yield from (Sample(number, None, fails) for number in range(3))

def decoder(scores, confidence=margin):
    return Decoder("evil", title="evil", confidence=confidence, scores=in_every_variant(scores))

def reader(open, takes=lambda path: path.suffix == ".evil", named=lambda source: False):
    return Reader("evil", "evil", open, takes, (".evil",), named)

def backend(make, unavailable=lambda: None):
    return BackendRow("evil", "evil", make=make, unavailable=unavailable)

PREPARES, SCORES = decoder(fails), decoder(lambda *_: fails)
SURE, REFUSES, LEAVES = decoder(lambda *_: lambda spikes: spikes[:, :8] + 1.0, fails), decoder(refuses), decoder(leaves)
TAKES, NAMED = reader(None, takes=fails), reader(None, lambda path: False, named=fails)
OPENS, WALKS, READS = reader(fails), reader(lambda _: Found(walk=fails)), reader(lambda _: Found(walk=drives))
MAKES, COUNTS, ASKED = backend(fails), backend(lambda *_: Counter()), backend(lambda *_: HostBackend(), fails)
WORSE = replace(COUNTS, name="worse")
SEES = Input("evil", layout=fails, sees="image", activity=fails, grey_levels=False, drawing="grey", legend="")
"""
FAILED = "of the package wicked 1.2 failed (RuntimeError: out of order); update or uninstall that package"


@pytest.mark.parametrize(
    ("attribute", "said"),
    [
        *((attribute, f"decoder 'evil' {FAILED}") for attribute in ("PREPARES", "SCORES", "SURE")),
        ("REFUSES", "decoder 'evil' of the package wicked 1.2 is left out: too few places"),
        ("LEAVES", f"decoder 'evil' {FAILED}".replace("RuntimeError: out of order", "SystemExit: 3")),
    ],
)
def test_a_decoder_that_fails_is_left_out_of_eval_and_ends_what_asks_for_it(
    install: Install, here: Path, attribute: str, said: str
) -> None:
    wanted = figures("query")["decoders"]
    install("wicked", "lava_vpr.decoders", {"evil": attribute}, FAILING)
    result = run("eval", "m.lvpr", "query", "--json", "f.json", "--report", "after.html")
    assert result.stderr == f"note: {said}\n"
    assert json.loads(Path("f.json").read_text())["decoders"] == wanted
    evil = replace(load("m.lvpr"), config=update(load("m.lvpr").config, {"decoder": {"default": "evil"}}))
    save(evil, Path("evil.lvpr"))
    ends = "too few places" if attribute == "REFUSES" else said
    assert [fails(*words, "evil.lvpr", "query") for words in (("query", "-o", "q.csv"), ("eval",))] == [ends, ends]


@pytest.mark.parametrize(
    ("group", "attribute", "command", "kind"),
    [
        *(("readers", attribute, "train a.evil -o n.lvpr", "reader") for attribute in ("OPENS", "WALKS", "READS")),
        *(
            ("backends", attribute, "query m.lvpr query -o q.csv --backend evil", "backend")
            for attribute in ("MAKES", "COUNTS")
        ),
        ("backends", "ASKED", "eval m.lvpr query --backend evil", "backend"),
        ("inputs", "SEES", "train reference -o n.lvpr --input evil", "kind of input"),
    ],
)
def test_a_row_that_fails_ends_what_asks_for_it_in_one_line(
    install: Install, here: Path, group: str, attribute: str, command: str, kind: str
) -> None:
    Path("a.evil").touch()
    install("wicked", f"lava_vpr.{group}", {"evil": attribute}, FAILING)
    assert fails(*command.split()) == f"{kind} 'evil' {FAILED}"


SOUND = """
import array, re
import numpy as np
from lava_vpr.inputs.encoder import Input
from lava_vpr.readers import Found, Reader

class Seen:
    def __init__(self, values):
        self.values = values
    def __array__(self, *_, **__):
        return np.array(self.values)

class Network:
    def __call__(self, number):
        return 2 * number
    def count_spikes(self, number):
        return 3 * number

ROW = Reader("sound", "sound", lambda wanted: Found(walk=lambda: {1, 2}), lambda path: re.search("s$", path.suffix), ())
GIVES = (Network, lambda: Seen(array.array("f", [1.0, 2.0])), lambda: array.array("f", [3.0]), lambda: [range(2), (4,)])
"""


def test_what_rows_that_do_not_fail_give_is_what_it_is(install: Install) -> None:
    """A truth value that is a match, a set to walk, an array by protocol, an object that is called and has methods."""
    install("mild", "lava_vpr.readers", {"sound": "ROW"}, SOUND)
    row = READERS["sound"]
    assert [bool(row.takes(Path(name))) for name in ("a.s", "a.t")] == [True, False]
    assert sorted(row.open(None).walk()) == [1, 2]  # type: ignore[arg-type, type-var]
    network, seen, numbers, parts = (
        made() for made in guarded.guarded(sys.modules["mild"].GIVES, "reader 'sound' of the package mild 1.2")
    )
    assert (network(2), network.count_spikes(2)) == (4, 6)
    np.testing.assert_array_equal(np.asarray(seen), [1.0, 2.0])
    np.testing.assert_array_equal(np.asarray(numbers), [3.0])
    assert [list(part) for part in parts] == [[0, 1], [4]]


@pytest.mark.parametrize("attribute", ["TAKES", "NAMED"])
def test_a_reader_that_fails_to_say_what_it_takes_hides_no_other(install: Install, here: Path, attribute: str) -> None:
    Path("a.scan").touch()
    Path("a.evil").touch()
    install("wicked", "lava_vpr.readers", {"evil": attribute}, FAILING)
    result = CliRunner().invoke(main, ["train", "a.evil", "-o", "n.lvpr"])
    note, line = result.stderr.splitlines()
    assert (result.exit_code, note) == (1, f"note: reader 'evil' {FAILED}")
    assert line.startswith("lava-vpr: error: a.evil: is of no known type; give ")
    install("yonder", "lava_vpr.readers", {"scans": "SCANS"}, READER)
    assert len(open_traverse("a.scan")) == 7


def test_a_backend_that_fails_ends_neither_doctor_nor_what_is_verified_beside_it(install: Install) -> None:
    install("wicked", "lava_vpr.backends", {"evil": "ASKED", "worse": "WORSE"}, FAILING)
    said = " ".join(run("doctor").output.split())
    assert f"backend 'evil' {FAILED}" in said
    verdicts = verify(small_model(), encoded(8), np.eye(8, dtype=bool), names=("host", "evil", "worse"))
    assert [verdict.reason for verdict in verdicts] == [None, f"backend 'evil' {FAILED}", f"backend 'worse' {FAILED}"]
