"""Inputs that cases start from: settings, lists, tables, arrays, and damaged copies of what other cases make, by name.

A text or bytes are a file, an array a ``.npy`` file, a mapping a folder; `Changed` is made of a file or folder of a row
of ``made.txt``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

PLACES = 20  # of the synthetic route


@dataclass(frozen=True)
class Changed:
    """A copy of ``source`` with other contents, by their names in it ("": the file itself): bytes, text, None for none,
    or a function of the old bytes."""

    source: str
    changes: Mapping[str, Any]


def half(data: bytes) -> bytes:
    """The first half."""
    return data[: len(data) // 2]


def short(data: bytes) -> bytes:
    """All but the last nine bytes."""
    return data[:-9]


def flipped(data: bytes) -> bytes:
    """One bit in the middle is another."""
    at = len(data) // 2
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


def _words(**values: object) -> Callable[[bytes], bytes]:
    """The change of a JSON object in some of its keys; None takes one away."""

    def change(data: bytes) -> bytes:
        found = {**json.loads(data), **values}
        return json.dumps({key: value for key, value in found.items() if value is not None}, indent=1).encode()

    return change


def _names(traverse: str, *numbers: int) -> str:
    """A list of images of the route."""
    return "".join(f"route/{traverse}/place_{k:05d}.png\n" for k in numbers)


def _table(header: str, *rows: object) -> str:
    return "\n".join([header, *map(str, rows)]) + "\n"


_VALUES = np.random.default_rng(3)
_COMMON, _OWN = 4 * _VALUES.normal(size=40), _VALUES.normal(size=(12, 40))
_DRIVES = [(_COMMON + _OWN + 0.3 * _VALUES.normal(size=_OWN.shape)).astype(np.float32) for _ in range(2)]
_QUICK = "[network]\nsteps = 256\n[learning]\nsteps = 300\nepochs = 6\n"
_PAPER = 'preset = "paper"\n[network]\nneurons = 12\nsteps = 2000\nrest_steps = 60\n'
_PLACE = "place_00003.png"
_TRUTH = {str(k): [k, k + 1] for k in range(PLACES)}

INPUTS: dict[str, Any] = {
    # Settings
    "quick.toml": _QUICK,
    "around.toml": _QUICK.replace("steps = 256", "steps = 256\nsurroundings = 4"),
    "paper.toml": _PAPER + "[learning]\nepochs = 3\nlabel_epochs = 2\n",
    "integer.toml": _QUICK + '[decoder]\ndefault = "standard"\n',
    "events.toml": "[network]\nsteps = 64\n[learning]\nsteps = 100\nepochs = 4\n[events]\nhot_pixels = 6.0\n",
    "vectors.toml": "[learning]\nepochs = 6\n",
    "unclosed.toml": "[network\n",
    "unknown.toml": "[network]\nneuron_count = 3\n",
    "range.toml": "[learning]\neta = -3.0\n",
    "type.toml": '[learning]\neta = "fast"\n',
    "section.toml": "learning = 3\n",
    "nan.toml": "[learning]\neta = nan\n",
    "loihi.toml": "preset = 'loihi'\n",
    "quickest.toml": "preset = 'quickest'\n",
    "endless.toml": "preset = 'paper'\n[learning]\ntau_theta_ms = inf\n",
    "overflow.toml": _QUICK.replace("[network]\n", "[network]\nthreshold = 1.0\ninhibition = 9000.0\n"),
    "binary.toml": b"\xff\xfe\x00\x01",
    # Lists of images
    "some.txt": _names("reference", 0, 2, 4, 6, 8, 10),
    "asked.txt": _names("query", 0, 2, 4, 6, 8, 10),
    "reversed.txt": _names("query", *range(PLACES - 1, -1, -1)),
    "table.csv": _table("image", *_names("reference", 1, 3, 5).split()),
    "paths.txt": _names("query", *range(8)),
    "paths_bad.txt": _names("query", 0) + "none.png\n" + _names("query", 1),
    "missing.txt": _names("reference", 0) + "route/reference/none.png\n",
    "nothing.txt": "# nothing\n",
    "one.txt": _names("reference", 0),
    # Ground truth
    "gt.txt": _table("# places", *(f"{k}: {k} {min(k + 1, PLACES - 1)}" for k in range(PLACES))),
    "gt.csv": _table("query,reference", *(f"{k},{k}" for k in range(PLACES))),
    "gt.json": json.dumps({str(k): [k] for k in range(PLACES)}),
    "gt_far.json": json.dumps(_TRUTH),
    "gt.npy": np.array([[k, k] for k in range(PLACES)]),
    "gt_bad.txt": "0: 1\n1: two\n",
    "gt_bad.json": "{",
    "gt_list.json": "[1, 2",
    "gt_nobody.json": json.dumps({"900": [1]}),
    "gt_float.npy": np.full((PLACES, 2), 0.5),
    # Positions and times
    "line.csv": _table("x,y", *(f"{20 * k},0" for k in range(PLACES))),
    "line_far.csv": _table("x,y", *(f"{20 * k + 9},3" for k in range(PLACES))),
    "degrees.csv": _table("lat,lon", *(f"{51 + k / 1e4},{-1 - k / 1e4}" for k in range(PLACES))),
    "few.csv": _table("x,y", "0,0", "1,0"),
    "nan.csv": _table("x,y", *(f"{k},{'nan' if k == 1 else 0}" for k in range(PLACES))),
    "words.csv": _table("x,y", *(f"{k},north" for k in range(PLACES))),
    "columns.csv": _table("east,up", "1,2"),
    "empty.csv": "",
    "poles.csv": _table("lat,lon", *(f"{70 + k},0" for k in range(PLACES))),
    "stamps.csv": _table("time", *(1719835200 + k for k in range(PLACES))),
    "stamps_back.csv": _table("time", *(1719835200 - k for k in range(PLACES))),
    "bad.gpx": "<gpx><trk>",
    "empty.gpx": '<gpx version="1.1" creator="x"></gpx>',
    "flat.gpx": '<gpx version="1.1" creator="x"><trk><trkseg><trkpt lat="51" lon="-1"/></trkseg></trk></gpx>',
    # Vectors and descriptors
    "ref.npy": _DRIVES[0],
    "query.npy": _DRIVES[1].astype(np.float64),
    "whole.npy": (9 * _DRIVES[0]).astype(np.int16),
    "wide.npy": np.ones((12, 41), np.float32),
    "nan.npy": np.where(np.arange(40) == 7, np.nan, _DRIVES[0]),
    "flat.npy": np.arange(12.0),
    "zero.npy": np.zeros((12, 40), np.float32),
    "none.npy": np.zeros((0, 40), np.float32),
    "text.npy": np.array([["a", "b"]] * 12),
    "objects.npy": np.array([{"a": 1}], dtype=object),
    "garbage.npy": b"\x93NUMPY\x01\x00\xff\xffrest",
    "rates.npy": np.abs(_DRIVES[0]),
    "d_ref.npy": np.random.default_rng(1).normal(size=(PLACES, 6)),
    "d_query.npy": np.random.default_rng(1).normal(size=(PLACES, 6)) + 0.1,
    "d_long.npy": np.random.default_rng(2).normal(size=(100, 6)),
    "d_few.npy": np.ones((5, 6)),
    "d_wide.npy": np.ones((PLACES, 7)),
    # Foreign, empty and cut files
    "empty.lvpr": b"",
    "text.lvpr": "I am no model\n",
    "empty.nir": b"",
    "text.net": "no network",
    "empty.npz": b"",
    "empty_events.h5": b"",
    "not_a_video.mp4": b"not a video",
    "file": "something",
    "empty_folder": {},
    "texts": {"a.txt": "hello"},
    "thesis": {"thesis.tex": "years of work"},
    "n.lvpr.checkpoint": b"lava-vpr checkpoint 1\nrest",
    "half.lvpr": Changed("m.lvpr", {"": half}),
    "short.lvpr": Changed("m.lvpr", {"": short}),
    "flipped.lvpr": Changed("m.lvpr", {"": flipped}),
    "longer.lvpr": Changed("m.lvpr", {"": lambda data: data + b"more"}),
    "later.lvpr": Changed("m.lvpr", {"": lambda data: data.replace(b"1", b"9", 1)}),
    "half.nir": Changed("net.nir", {"": half}),
    "half.net": Changed("net.net", {"": half}),
    "half_events.h5": Changed("aedat/dsec.h5", {"": half}),
    "zero_query": Changed("route/query", {_PLACE: b""}),
    "cut_query": Changed("route/query", {_PLACE: lambda data: data[:-40]}),
    "cut_reference": Changed("route/reference", {_PLACE: lambda data: data[:60]}),
    "text_reference": Changed("route/reference", {_PLACE: "I am no image"}),
    "fewer_query": Changed("route/query", {_PLACE: None}),
    "more_query": Changed("route/query", {"place_00020.png": b"", "place_00021.png": b""}),
    # Damaged bundles
    "kb_cut": Changed("kb", {"host/responses.npy": half}),
    "kb_flipped": Changed("kb", {"host/responses.npy": flipped}),
    "kb_missing": Changed("kb", {"host/responses.npy": None}),
    "kb_more": Changed("kb", {"mine.txt": "notes"}),
    "kb_program": Changed("kb", {"program/run.py": "print('other')\n"}),
    "kb_manifest": Changed("kb", {"manifest.json": half}),
    "kb_empty": Changed("kb", {"manifest.json": b""}),
    "kb_none": Changed("kb", {"manifest.json": None}),
    "kb_format": Changed("kb", {"manifest.json": _words(version=99)}),
    "kb_target": Changed("kb", {"manifest.json": _words(target="tianjic")}),
    "kb_files": Changed("kb", {"manifest.json": _words(files=None)}),
    "kb_mapping": Changed("kb", {"mapping.json": half}),
    "l2_cut": Changed("l2", {"network/weights.npy": short}),
    "l2_missing": Changed("l2", {"network/parameters.json": None}),
}
"""What is named so is there, in the folder of every case that names it."""
