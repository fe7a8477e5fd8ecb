"""The program's readers, each with the checker that judges what it took.

Used by storage and support.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from support.fuzz.files.cases import Case
from support.fuzz.files.corpus import PLACES, SETTINGS, Corpus
from support.fuzz.files.lists import IMAGE_LISTS
from support.fuzz.soundness import bundles, checkpoints, lists, models, settings
from support.fuzz.soundness.rules import Findings

from lava_vpr.backends.opening import open_model
from lava_vpr.config import PRESETS
from lava_vpr.configfile import read_toml, to_dict
from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.deploy.bundle.learning import SETTINGS as LEARNING
from lava_vpr.deploy.bundle.learning import read_learning
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.model import Model, save
from lava_vpr.positions.gpx import read_gpx
from lava_vpr.positions.tables import read_table
from lava_vpr.training.loop import split, train
from lava_vpr.training.trainers import trainer_of
from lava_vpr.traverse import open_traverse
from lava_vpr.truth.groundtruth import read_ground_truth


def view(model: Model) -> dict[str, Any]:
    """``model`` as the checkers take it: plain dictionaries and arrays."""
    arrays = {name: getattr(model, name) for name in models.VALUES}
    numbers: dict[str, int] | None = None
    if isinstance(model.network, FixedNetwork):
        numbers = model.network.scalars
        if model.bundle is None:
            arrays["network.weights"] = model.network.weights
    else:
        for field in dataclasses.fields(model.network):
            arrays[f"network.{field.name}"] = getattr(model.network, field.name)
    return {
        "config": to_dict(model.config),
        "arrays": arrays,
        "weights": model.network.weights,
        "bias": getattr(model.network, "bias", None),
        "numbers": numbers,
        "names": model.place_names,
        "route_images": model.route_images,
        "stretches": [part.row for part in model.stretches],
    }


def read_model(case: Case, corpus: Corpus, path: Path) -> Findings:
    """A model file."""
    model = open_model(path)
    return models.check_model(path.read_bytes(), view(model))


def read_bundle(case: Case, corpus: Corpus, path: Path) -> Findings:
    """A bundle, and the network in it that learns, if there is one."""
    model = open_model(path)
    opened = bundle_folder.load(path)
    if LEARNING in opened.files:
        read_learning(opened)
    return bundles.check_bundle(path, view(model))


def training(corpus: Corpus, name: str) -> dict[str, Any]:
    """What the checker is told of the training that goes on from the checkpoint ``name``."""
    config = SETTINGS[name]
    trainers = [
        trainer_of(config, stretch, number, np.zeros((0, 0), np.float32))
        for number, stretch in enumerate(split(PLACES, config))
    ]
    return {
        "fingerprint": corpus.fingerprint(name),
        "config": to_dict(config),
        "shapes": [{key: (array.dtype.str, array.shape) for key, array in t.state().items()} for t in trainers],
        "images": len(corpus.references[name]),
    }


def read_checkpoint(case: Case, corpus: Corpus, path: Path) -> Findings:
    """A checkpoint, from which a training goes on; what it comes to is a sound model."""
    config, references = SETTINGS[case.honest], corpus.references[case.honest]
    data = path.read_bytes() if path.is_file() else b""
    trained = train(references, config, jobs=1, checkpoint=path, resume=True)
    findings = checkpoints.check_checkpoint(data, training(corpus, case.honest))
    if not findings:
        save(trained, path.with_name("after.lvpr"))
        findings += models.check_model(path.with_name("after.lvpr").read_bytes(), view(trained))
    return findings


def read_settings(case: Case, corpus: Corpus, path: Path) -> Findings:
    """Settings in TOML."""
    config = read_toml(path)
    presets = {name: to_dict(make()) for name, make in PRESETS.items()}
    return settings.check_toml(path.read_bytes(), to_dict(config), presets)


def read_list(case: Case, corpus: Corpus, path: Path) -> Findings:
    """A list of images, a ground truth or positions."""
    findings = Findings()
    if case.honest.startswith("truth"):
        numbers = np.arange(PLACES, dtype=np.int64)
        return lists.check_truth(path, read_ground_truth(path, numbers, numbers), findings)
    if case.honest in IMAGE_LISTS:
        return lists.check_list(path, [str(file) for file in open_traverse(path).paths], findings)
    if case.honest.endswith(".gpx"):
        return lists.check_gpx(path, read_gpx(path).positions.values, findings)
    return lists.check_positions(path, read_table(path).positions.values, findings)
