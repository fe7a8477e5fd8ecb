"""Checkpoints: the state of a training on disk, from which it can resume after it was killed."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.configfile import to_dict
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.errors import ModelFileError, brief, shown
from lava_vpr.model import Stretch
from lava_vpr.modelfile import count
from lava_vpr.storage import container
from lava_vpr.storage.arrays import UnexpectedError, UnfitError
from lava_vpr.storage.writing import leftovers
from lava_vpr.training.trainers import StretchTrainer, restore


def check_resume(path: Path, resume: bool) -> None:
    """Refuse, before any work is done, to resume from nothing, or to start over where a training was interrupted.

    Raises:
        ModelFileError: there is a checkpoint and ``resume`` is not asked for, or the other way round.
    """
    if path.exists() and not resume:
        raise ModelFileError(
            f"{path}: an interrupted training can go on from here; add --resume, or delete the file to start over"
        )
    if resume and not path.exists():
        raise _nothing_to_resume(path)


def _nothing_to_resume(path: Path) -> ModelFileError:
    return ModelFileError(f"{path}: there is no checkpoint to resume from; train without --resume")


def remove_checkpoint(path: Path) -> None:
    """Remove the checkpoint of a finished training, and temporary files left by writes that were killed."""
    for file in (path, *leftovers(path)):
        file.unlink(missing_ok=True)


def fingerprint(references: Sequence[EncodedTraverse], config: Config, stretches: Sequence[Stretch]) -> str:
    """Hash of everything that decides the trained weights: settings, the cut into stretches, and images."""
    digest = hashlib.sha256(json.dumps(to_dict(config), sort_keys=True).encode())
    digest.update(json.dumps([stretch.places for stretch in stretches]).encode())
    for reference in references:
        digest.update(reference.indices.tobytes())
        digest.update(reference.activity.tobytes())
    return digest.hexdigest()


def _epochs_done(header: dict[str, Any], stretches: int, most: int) -> dict[int, int]:
    """The whole epochs that each stretch has done, of ``most``.

    Raises:
        UnfitError: the header of a checkpoint says something else.
    """
    if set(header) != {"fingerprint", "epochs"}:
        raise UnfitError(f"the header with keys {brief(sorted(header))}")
    epochs = header["epochs"]
    if not isinstance(epochs, dict) or not epochs:
        raise UnfitError(f"epochs {brief(epochs)}")
    numbers = {str(number): number for number in range(stretches)}
    for name in epochs:
        if name not in numbers:
            raise UnfitError(f"a stretch {brief(name)} of {stretches}")
    return {numbers[name]: count(value, f"epochs of stretch {name}", 1, most) for name, value in epochs.items()}


def _by_stretch(arrays: dict[str, NDArray[Any]], done: dict[int, int]) -> dict[int, dict[str, NDArray[Any]]]:
    """The arrays of each stretch by their own names.

    Raises:
        UnfitError: an array belongs to no stretch that has done an epoch.
    """
    states: dict[int, dict[str, NDArray[Any]]] = {number: {} for number in done}
    numbers = {str(number): number for number in done}
    for name, array in arrays.items():
        number, _, own = name.partition(".")
        if number not in numbers:
            raise UnexpectedError(f"an unexpected array {brief(name)}")
        states[numbers[number]][own] = array
    return states


@dataclass
class Checkpoint:
    """The state of a training on disk: that of each stretch after its last complete epoch.

    ``interval`` is the shortest time in seconds between two writes (0: write every state); the result does not depend
    on it. Slow writes are followed by longer pauses, so that writing takes at most a tenth of the time.
    """

    path: Path | None
    fingerprint: str
    interval: float = 2.0
    epochs: dict[int, int] = field(default_factory=dict)
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _written: float = field(default_factory=time.monotonic)
    _took: float = 0.0

    def load(self, trainers: Sequence[StretchTrainer], epochs: int, traverses: int) -> None:
        """Load the state on disk: the epochs done, and the state of each stretch's trainer.

        Args:
            trainers: The trainers of all stretches, new ones.
            epochs: Epochs that a whole training has.
            traverses: Reference traverses.
        Raises:
            ModelFileError: no checkpoint, a damaged or invalid one, or one of other settings or images.
        """
        if self.path is None:
            raise ModelFileError("there is nowhere to resume from; name the checkpoint")
        if not self.path.exists():
            raise _nothing_to_resume(self.path)
        header, arrays = container.load(self.path, "checkpoint")
        if header.get("fingerprint") != self.fingerprint:
            raise ModelFileError(
                f"{shown(self.path)}: was made with other options or images; repeat the original command with "
                "--resume, or delete it and train without --resume"
            )
        try:
            done = _epochs_done(header, len(trainers), epochs)
            states = _by_stretch(arrays, done)
            for number, epoch in done.items():
                restore(trainers[number], states[number], epoch, traverses)
        except UnfitError as error:
            raise ModelFileError(
                f"{shown(self.path)}: the checkpoint {error.how} {error}; {container.REMEDIES['checkpoint']}"
            ) from None
        self.epochs, self.arrays = done, arrays

    def update(self, number: int, epoch: int, state: dict[str, NDArray[Any]]) -> None:
        """Note that stretch ``number`` has finished ``epoch`` epochs, and write if it is time."""
        if self.path is None:
            return
        with self._lock:
            self.epochs[number] = epoch
            self.arrays.update({f"{number}.{name}": value.copy() for name, value in state.items()})
            pause = max(self.interval, 10 * self._took) if self.interval else 0.0
            if time.monotonic() - self._written >= pause:
                self._write()

    def flush(self) -> None:
        """Write the latest state, if there is any (called when training is interrupted)."""
        with self._lock:
            if self.path is not None and self.epochs:
                self._write()

    def _write(self) -> None:
        if self.path is None:
            return
        header = {"fingerprint": self.fingerprint, "epochs": {str(k): v for k, v in self.epochs.items()}}
        began = time.monotonic()
        container.save(self.path, "checkpoint", header, self.arrays)
        self._written = time.monotonic()
        self._took = self._written - began
