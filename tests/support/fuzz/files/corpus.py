"""The honest files that are changed: small models, bundles and checkpoints of every kind, settings, lists, truths.

Used by storage and support.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lava_vpr.config import Config, preset
from lava_vpr.configfile import to_toml, update
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.encoding import EncodedTraverse, Keep, encode_views
from lava_vpr.model import Model, save
from lava_vpr.training.checkpoint import Checkpoint, fingerprint
from lava_vpr.training.loop import split, train
from lava_vpr.training.trainers import trainer_of
from lava_vpr.traverse import open_traverse

PLACES, TRAVERSES = 6, 2
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


@dataclass
class Corpus:
    """Honest files by name, and the folder in which the images are that they were made of.

    Attributes:
        folder: Holds ``reference``, ``second`` and ``query``, folders of images, and all of these files, too.
        models, checkpoints: Containers.
        bundles: Files of each bundle by name.
        texts: Settings.
        references: The images that a checkpoint was made of.
    """

    folder: Path
    models: dict[str, bytes] = field(default_factory=dict)
    checkpoints: dict[str, bytes] = field(default_factory=dict)
    bundles: dict[str, dict[str, bytes]] = field(default_factory=dict)
    texts: dict[str, bytes] = field(default_factory=dict)
    references: dict[str, list[EncodedTraverse]] = field(default_factory=dict)

    def fingerprint(self, name: str) -> str:
        """The fingerprint of the checkpoint ``name``."""
        return fingerprint(self.references[name], SETTINGS[name], split(PLACES, SETTINGS[name]))


def make(folder: Path) -> Corpus:
    """Make all honest files; they are the same at every call."""
    made = Corpus(folder)
    for seed, name in enumerate(("reference", "second", "query")):
        _draw(folder / name, seed)
    for name, config in SETTINGS.items():
        sources = ("reference",) if name == "paper" else ("reference", "second")
        made.references[name] = [
            seen
            for source in sources
            for seen in encode_views(open_traverse(folder / source), config.encoder, config.views.views, Keep.ALL)
        ]
        model = train(made.references[name], config, jobs=1)
        save(model, folder / f"{name}.lvpr")
        made.models[name] = (folder / f"{name}.lvpr").read_bytes()
        made.texts[name] = to_toml(config).encode()
        (folder / f"{name}.toml").write_bytes(made.texts[name])
        if name in INTERRUPTED:
            made.checkpoints[name] = _interrupted(folder / "c.checkpoint", made.references[name], config)
        for bundle, (of, board, learns) in BUNDLES.items():
            if of == name:
                made.bundles[bundle] = _deployed(model, board, learns, folder / bundle)
    return made


def _draw(folder: Path, seed: int) -> None:
    """Blocky images of one traverse: all show the same places, each with noise of its own."""
    folder.mkdir(parents=True)
    noise = np.random.default_rng(seed + 100)
    for place in range(PLACES):
        small = np.random.default_rng(place).integers(0, 200, (6, 8, 3)) + noise.integers(0, 55, (6, 8, 1))
        picture = np.kron(small, np.ones((8, 8, 1)))
        cv2.imwrite(str(folder / f"img{place}.png"), picture.astype(np.uint8))


def _interrupted(path: Path, references: list[EncodedTraverse], config: Config) -> bytes:
    """The checkpoint of a training in which the first stretch has done two epochs."""
    store = Checkpoint(path, fingerprint(references, config, split(PLACES, config)), interval=1e9)
    stretches = split(PLACES, config)
    for number, stretch in enumerate(stretches):
        trainer = trainer_of(config, stretch, number, np.zeros((0, 0), np.float32))
        store.update(number, 2 if number == 0 else 1, trainer.state())
    store.flush()
    data = path.read_bytes()
    path.unlink()
    return data


def _deployed(model: Model, board: str, learns: bool, path: Path) -> dict[str, bytes]:
    """The files of a bundle by name, its manifest among them."""
    deploy(model, BOARDS[board], path, learning=learns, picture=False)
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


def manifest_of(files: dict[str, bytes]) -> dict[str, Any]:
    """The manifest of an honest bundle."""
    value: dict[str, Any] = json.loads(files["manifest.json"])
    return value
