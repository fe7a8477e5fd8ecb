"""A checkpoint with a right checksum is held against what its training can have saved."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.common.small_models import encoded, small_config, tiny_paper

from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.errors import ModelFileError
from lava_vpr.storage import container
from lava_vpr.training import checkpoint
from lava_vpr.training.checkpoint import Checkpoint, fingerprint
from lava_vpr.training.loop import split, train
from lava_vpr.training.trainers import rule_of

Header = dict[str, Any]
Arrays = dict[str, np.ndarray]
Forge = Callable[[Header, Arrays], object]


def settings(kind: str) -> tuple[Config, list[EncodedTraverse]]:
    if kind == "paper":
        return tiny_paper(), [encoded(inputs=784)]
    learning = {"arithmetic": "integer"} if kind == "integer" else {}
    return small_config(learning=learning), [encoded()]


NO_IMAGES = np.zeros((0, 0), np.float32)


@cache
def saved(kind: str) -> tuple[Header, Arrays]:
    """A sound checkpoint: one epoch of every stretch."""
    config, references = settings(kind)
    stretches = split(8, config)
    states = [rule_of(config).trainer(config, stretch, k, NO_IMAGES).state() for k, stretch in enumerate(stretches)]
    arrays = {f"{k}.{name}": array for k, state in enumerate(states) for name, array in state.items()}
    epochs = {str(k): 1 for k in range(len(states))}
    return {"fingerprint": fingerprint(references, config, stretches), "epochs": epochs}, arrays


def resumed(kind: str, forge: Forge, path: Path) -> None:
    config, references = settings(kind)
    header, arrays = saved(kind)
    header = {**header, "epochs": dict(header["epochs"])}
    arrays = {name: array.copy(order="A") for name, array in arrays.items()}
    forge(header, arrays)
    container.save(path, "checkpoint", header, arrays)
    train(references, config, checkpoint=path, resume=True)


def epochs(value: object) -> Forge:
    return lambda header, arrays: header.__setitem__("epochs", value)


def first(name: str, value: object) -> Forge:
    return lambda header, arrays: arrays[name].flat.__setitem__(0, value)


def changed(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Forge:
    return lambda header, arrays: arrays.__setitem__(name, change(arrays[name]))


FORGED: list[tuple[str, Forge, str]] = [
    *(("loihi", epochs(v), "epochs") for v in ([1], 5, {}, None, {"0": 6, "1": 1}, {"0": 0, "1": 1}, {"0": 10**300})),
    *(("loihi", epochs({"0": v, "1": 1}), "epochs of stretch 0") for v in (-1, "2", True, 1.0, None, [1])),
    *(("loihi", epochs({"0": 1, "1": 1, v: 1}), "a stretch") for v in ("2", "-1", "01", " 1", "x" * 10**6, "\x1b")),
    ("loihi", epochs({"0": 1}), "the checkpoint has an unexpected array '1."),
    ("loihi", lambda header, arrays: header.__setitem__("more", 1), "the header with keys"),
    ("loihi", lambda header, arrays: arrays.pop("1.theta"), "'theta'"),
    ("loihi", lambda header, arrays: arrays.__setitem__("0.more", np.zeros(2)), "an unexpected array 'more'"),
    ("loihi", lambda header, arrays: arrays.__setitem__("2.theta", np.zeros(2)), "an unexpected array '2.theta'"),
    *(("loihi", first("0.weights", v), "weights with values") for v in (np.nan, np.inf, -1e-6, 500)),
    *(("loihi", first("1.theta", v), "theta with values") for v in (np.nan, np.inf, -1, 1e6)),
    ("loihi", changed("0.weights", lambda a: a.astype(np.int8)), "weights of type int8"),
    ("loihi", changed("0.weights", lambda a: a.astype(np.float64)), "weights of type float64"),
    ("loihi", changed("0.weights", lambda a: a[:1]), "weights of shape (1, 4)"),
    ("loihi", changed("0.weights", lambda a: a.T), "weights of shape (4, 1568)"),
    ("loihi", changed("0.theta", lambda a: a[0]), "theta of shape ()"),
    *(("integer", first("0.theta", v), f"theta with values from {v} to") for v in (-1, 0)),
    ("integer", changed("0.weights", lambda a: a.astype(np.float32)), "weights of type float32"),
    *(("paper", first("0.weights", v), "weights with values") for v in (np.nan, -1e-6, 500)),
    *(("paper", first("0.theta_mv", v), "theta_mv with values") for v in (np.nan, -1, 1e9)),
    ("paper", first("0.responses", 1), "responses with values"),
    ("paper", first("0.responses", -1), "responses with values"),
    ("paper", first("0.delays", 99), "delays that differ from those that the seed gives"),
    ("paper", changed("0.delays", lambda a: a.astype(np.int16)), "delays of type int16"),
]


@pytest.mark.parametrize(
    ("kind", "forge", "cause"), FORGED, ids=[f"{number}-{row[2][:40]}" for number, row in enumerate(FORGED)]
)
def test_what_no_training_saves_is_refused(kind: str, forge: Forge, cause: str, tmp_path: Path) -> None:
    path = tmp_path / "a.checkpoint"
    with pytest.raises(ModelFileError) as caught:
        resumed(kind, forge, path)
    message = str(caught.value)
    assert message.startswith((f"{path}: the checkpoint has no valid ", f"{path}: the checkpoint has an unexpected "))
    assert cause in message
    assert message.endswith("; delete it and train from the start, without --resume")
    assert message.isprintable()
    assert len(message) < 400
    assert path.exists()


@pytest.mark.parametrize("kind", ["loihi", "integer", "paper"])
def test_what_training_saves_is_taken(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After every epoch: nothing that a training saves is beyond the bounds of what it can have saved."""
    config, references = settings(kind)
    path, update, taken = tmp_path / "a.checkpoint", Checkpoint.update, []

    def checked(self: Checkpoint, number: int, epoch: int, state: Arrays) -> None:
        update(self, number, epoch, state)
        trainers = [
            rule_of(config).trainer(config, stretch, k, NO_IMAGES) for k, stretch in enumerate(split(8, config))
        ]
        store = Checkpoint(path, self.fingerprint)
        store.load(trainers, config.learning.epochs, len(references))
        taken.append(store.epochs[number])

    monkeypatch.setattr(Checkpoint, "update", checked)
    train(references, config, checkpoint=path, interval=0.0)
    assert taken == [*range(1, config.learning.epochs + 1)] * len(split(8, config))


def test_writes_take_a_tenth_of_the_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A state each second; a write that takes 3 seconds is followed by a pause of 30, a short one by the interval."""
    clock, written = [0.0], []
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: clock[0])

    def save(*what: object) -> None:
        written.append(clock[0])
        clock[0] += 3.0 if clock[0] < 50 else 0.01

    monkeypatch.setattr(checkpoint.container, "save", save)
    store = Checkpoint(tmp_path / "c", "", interval=2.0)
    store._written = 0.0
    for _ in range(80):
        clock[0] += 1.0
        store.update(0, 1, {"weights": np.zeros(2)})
    assert written[:2] == [2.0, 35.0]
    assert np.allclose(np.diff(written[2:]), 2.0, atol=0.02)
    assert len(written) > 5
