"""The honest files that are changed: small models, bundles and checkpoints of every kind, settings, lists, truths.

Used by storage and support.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from support.fuzz import damage
from support.fuzz.changes import Files, stored

from lava_vpr.cluster.tasks import ONE_THREAD
from lava_vpr.config import Config, preset
from lava_vpr.configfile import to_toml, update
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.encoding import EncodedTraverse, Keep, encode_views
from lava_vpr.model import Model, save
from lava_vpr.training.checkpoint import Checkpoint, fingerprint
from lava_vpr.training.loop import split, train
from lava_vpr.training.trainers import rule_of
from lava_vpr.traverse import open_traverse

PLACES = 6
BASE: dict[str, Any] = {
    "stretch": 3,
    "encoder": {"image_size": 8, "cell": 4, "orientations": 2, "window": 3, "query_spikes": 2.0},
    "network": {"steps": 32, "weight_bits": 5},
    "learning": {"steps": 30, "epochs": 3, "competition_epochs": 1},
}
PAPER: dict[str, Any] = {
    "network": {"neurons": 5, "steps": 300, "rest_steps": 20},
    "learning": {"epochs": 3, "label_epochs": 2},
}
SETTINGS: dict[str, Config] = {
    "float": update(preset("loihi"), BASE),
    "integer": update(update(preset("loihi"), BASE), {"learning": {"arithmetic": "integer", "mu": 1.0}}),
    "bias": update(update(preset("fast"), BASE), {"network": {"input_mode": "bias"}}),
    "pixels": update(update(preset("loihi"), BASE), {"encoder": {"kind": "pixels"}, "stretch": 0}),
    "views": update(update(preset("fast"), BASE), {"views": {"shifts": 3, "shift": 0.1}, "network": {"signed": False}}),
    "paper": update(preset("paper"), PAPER),
}
"""The settings of the models, by name."""

BUNDLES = {
    "kapoho-bay": ("float", "kapoho-bay", False),
    "kapoho-bay-bias": ("bias", "kapoho-bay", False),
    "loihi2": ("float", "loihi2", False),
    "loihi2-learning": ("float", "loihi2", True),
}
"""Model, board and whether it learns, by the bundle's name."""

INTERRUPTED = ("float", "integer", "paper")
PATHS = tuple(f"../query/img{k}.png" for k in range(PLACES))
NEAR = [[k] if k % 2 else [k, (k + 1) % PLACES] for k in range(PLACES)]
METRES = [(10.0 * k, 2.5 * k) for k in range(PLACES)]
DEGREES = [(50 + x / 1e5, 8 + y / 1e5) for x, y in METRES]
GPX = '<?xml version="1.0"?>\n<gpx version="1.1" creator="a">\n<trk><trkseg>\n{}</trkseg></trk>\n</gpx>\n'


def _text(lines: Iterable[str]) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode()


LISTS: dict[str, bytes] = {
    "list.txt": _text(["# images", *PATHS]),
    "plain.csv": _text(f"{path},{k}" for k, path in enumerate(PATHS)),
    "list.csv": _text(["number,image,weather", *(f"{k},{path},sun" for k, path in enumerate(PATHS))]),
    "truth.txt": _text(f"{k}: {' '.join(map(str, near))}" for k, near in enumerate(NEAR)),
    "truth.csv": _text(["query,places", *(f"{k},{';'.join(map(str, near))}" for k, near in enumerate(NEAR))]),
    "truth.json": json.dumps({str(k): near for k, near in enumerate(NEAR)}).encode(),
    "truth-list.json": json.dumps(NEAR).encode(),
    "truth.npy": stored(np.arange(PLACES)),
    "truth-pairs.npy": stored(np.array([(k, place) for k, near in enumerate(NEAR) for place in near])),
    "truth-matrix.npy": stored(np.eye(PLACES, dtype=bool)),
    "positions.csv": _text(["x,y", *(f"{x},{y}" for x, y in METRES)]),
    "plain-positions.csv": _text(f"{x},{y}" for x, y in METRES),
    "degrees.csv": _text(["lat,lon", *(f"{a},{b}" for a, b in DEGREES)]),
    "track.gpx": GPX.format("".join(f'<trkpt lat="{a}" lon="{b}"><ele>1</ele></trkpt>\n' for a, b in DEGREES)).encode(),
}
"""Lists of images, truths of six queries and places, positions."""

IMAGE_LISTS = ("list.txt", "list.csv", "plain.csv")


@dataclass
class Corpus:
    """Honest files, and the folder in which the images are that they were made of.

    Attributes:
        folder: Holds ``reference``, ``second`` and ``query``, folders of images, and these files, too.
        files: Of each format, the content of every file by the name of what they are; a bundle has several.
        references: The images that a checkpoint was made of.
    """

    folder: Path
    files: dict[str, dict[str, Files]] = field(default_factory=dict)
    references: dict[str, list[EncodedTraverse]] = field(default_factory=dict)

    def fingerprint(self, name: str) -> str:
        """The fingerprint of the checkpoint ``name``."""
        return fingerprint(self.references[name], SETTINGS[name], split(PLACES, SETTINGS[name]))


def make(folder: Path) -> Corpus:
    """Make all honest files; they are the same at every call."""
    made = Corpus(folder, {kind: {} for kind in ("model", "bundle", "checkpoint", "settings")})
    made.files["list"] = {name: {name: data} for name, data in LISTS.items()}
    for seed, name in enumerate(("reference", "second", "query")):
        _draw(folder / name, seed)
    for name, config in SETTINGS.items():
        sources = ("reference",) if name == "paper" else ("reference", "second")
        made.references[name] = [
            seen
            for source in sources
            for seen in encode_views(open_traverse(folder / source), config.encoder, config.views.views, Keep.ALL)
        ]
        model = train(made.references[name], config, pool=ONE_THREAD)
        save(model, folder / f"{name}.lvpr")
        (folder / f"{name}.toml").write_text(to_toml(config))
        made.files["model"][name] = {"m.lvpr": (folder / f"{name}.lvpr").read_bytes()}
        made.files["settings"][name] = {"settings.toml": to_toml(config).encode()}
        if name in INTERRUPTED:
            made.files["checkpoint"][name] = {"n.lvpr.checkpoint": _interrupted(folder / "c", made, name)}
        for bundle, (of, board, learns) in BUNDLES.items():
            if of == name:
                made.files["bundle"][bundle] = _deployed(model, board, learns, folder / bundle)
    made.files |= damage.files(folder)
    return made


def _draw(folder: Path, seed: int) -> None:
    """Blocky images of one traverse: all show the same places, each with noise of its own."""
    folder.mkdir(parents=True)
    noise = np.random.default_rng(seed + 100)
    for place in range(PLACES):
        small = np.random.default_rng(place).integers(0, 200, (6, 8, 3)) + noise.integers(0, 55, (6, 8, 1))
        picture = np.kron(small, np.ones((8, 8, 1)))
        cv2.imwrite(str(folder / f"img{place}.png"), picture.astype(np.uint8))


def _interrupted(path: Path, made: Corpus, name: str) -> bytes:
    """The checkpoint of a training in which the first stretch has done two epochs."""
    config = SETTINGS[name]
    store = Checkpoint(path, made.fingerprint(name), interval=1e9)
    for number, stretch in enumerate(split(PLACES, config)):
        state = rule_of(config).trainer(config, stretch, number, np.zeros((0, 0), np.float32)).state()
        store.update(number, 2 if number == 0 else 1, state)
    store.flush()
    return path.read_bytes()


def _deployed(model: Model, board: str, learns: bool, path: Path) -> Files:
    """The files of a bundle by name, its manifest among them."""
    deploy(model, BOARDS[board], path, learning=learns, picture=False)
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}
