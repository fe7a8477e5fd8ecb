"""Training of stretches, epoch by epoch, on threads of this process or by a cluster's workers.

A stretch sees only its own images, so what it learns depends only on those, the settings and the seed. On threads, all
trainers live in this process, and the state of each is kept after every epoch. A cluster's worker gets a stretch with
its images, learns all epochs, and sends back its trainer's state.

`Monitor` reports on a training; `learning_bar` shows its progress over all presentations.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import Config, as_integer_config
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.learning.recruiting import key_again, recruit, rounds
from lava_vpr.engine.random import image_keys, presentation_key, stretch_key
from lava_vpr.engine.rates import training_rates
from lava_vpr.errors import shown
from lava_vpr.model import Stretch
from lava_vpr.training.checkpoint import Checkpoint
from lava_vpr.training.measuring import coverage
from lava_vpr.training.trainers import StretchTrainer, restore, rule_of


@dataclass(frozen=True)
class Progress:
    """Progress of one stretch; ``neurons_used`` and ``places_covered`` are those of its last complete epoch."""

    stretch: int
    epoch: int
    presentations: int
    spikes_per_image: float
    neurons_used: int
    places_covered: int


Shown = Callable[[Progress], None]


class Lesson(NamedTuple):
    """A stretch as a task.

    Attributes:
        stretch: The stretch.
        activity: Input responses to its images in its view, float32 (traverses, places, inputs).
        epochs: Whole epochs that it has learned before.
        state: State of its trainer after those (`StretchTrainer.state`); empty before the first.
    """

    stretch: Stretch
    activity: NDArray[np.float32]
    epochs: int
    state: dict[str, NDArray[Any]]


class Images(NamedTuple):
    """The images of a stretch in its view, as training shows them.

    Attributes:
        rates: Of each traverse, (places, inputs).
        keys: Image keys of each traverse, uint64 (places,).
    """

    rates: list[NDArray[Any]]
    keys: list[NDArray[np.uint64]]


def activity_of(stretch: Stretch, references: Sequence[EncodedTraverse], config: Config) -> NDArray[np.float32]:
    """Input responses to the images of ``stretch`` in its view, float32 (traverses, places, inputs)."""
    places, views = slice(stretch.first_place, stretch.first_place + stretch.places), len(config.views.views)
    return np.stack([reference.activity[places] for reference in references[stretch.view :: views]])


def images_of(activity: NDArray[np.float32], config: Config) -> Images:
    """The images with these responses (traverses, places, inputs), as training shows them."""
    rates = [training_rates(traverse, config) for traverse in activity]
    return Images(rates, [image_keys(traverse) for traverse in rates])


def trainers_of(
    stretches: Sequence[Stretch], references: Sequence[EncodedTraverse], config: Config
) -> list[StretchTrainer]:
    """A new trainer for each of ``stretches``."""
    return [_trainer(stretch, activity_of(stretch, references, config), config) for stretch in stretches]


def _trainer(stretch: Stretch, activity: NDArray[np.float32], config: Config) -> StretchTrainer:
    """A new trainer of a stretch with these images, (traverses, places, inputs)."""
    first = images_of(activity[:1], config).keys[0]  # start weights are drawn for these
    return rule_of(config).trainer(config, stretch, stretch_key(first), activity.reshape(-1, activity.shape[2]))


def learn(
    trainers: Sequence[StretchTrainer],
    stretches: Sequence[Stretch],
    references: Sequence[EncodedTraverse],
    config: Config,
    *,
    pool: Pool = ONE_THREAD,
    store: Checkpoint | None = None,
    progress: Shown | None = None,
) -> None:
    """Train all ``stretches``; each trainer sees only the images of its own stretch.

    An interrupt or error stops all and saves the state so far.

    Args:
        trainers, stretches: The trainer of each stretch, which is changed.
        references, config, pool, progress: As in `lava_vpr.training.loop.train`.
        store: Checkpoint with the state so far; None: start from the beginning, and write no checkpoint.
    """
    known = Checkpoint(None, "") if store is None else store
    epochs, views, stop = config.learning.epochs, len(config.views.views), threading.Event()
    left = [number for number in range(len(stretches)) if known.epochs.get(number, 0) < epochs]

    def learn_here(shared: None, number: int) -> None:
        images = images_of(activity_of(stretches[number], references, config), config)
        for epoch in range(known.epochs.get(number, 0), epochs):
            if not _epoch(trainers[number], stretches[number], number, epoch, images, config, views, progress, stop):
                return
            known.update(number, epoch + 1, trainers[number].state())

    def lesson(number: int) -> Lesson:
        activity, done = activity_of(stretches[number], references, config), known.epochs.get(number, 0)
        return Lesson(stretches[number], activity, done, trainers[number].state() if done else {})

    try:
        if pool.here:
            with closing(pool.as_done(learn_here, left, shared=None, called="stretches", stop=stop)) as found:
                for _ in found:
                    pass
            return
        lessons = (lesson(number) for number in left)
        with closing(pool.as_done(learned, lessons, shared=config, called="stretches", total=len(left))) as states:
            for at, state in states:
                trainer = trainers[left[at]]
                restore(trainer, state, epochs, len(references) // views)
                known.update(left[at], epochs, trainer.state())
        known.flush()  # the next stage uses the cluster, too, and may lose it
    except BaseException:
        known.flush()
        raise


def learned(config: Config, lesson: Lesson) -> dict[str, NDArray[Any]]:
    """The state of a stretch's trainer after all epochs; a task of a cluster.

    Args:
        config: Settings.
        lesson: The stretch, from an epoch on.
    """
    stretch, images, traverses = lesson.stretch, images_of(lesson.activity, config), len(lesson.activity)
    trainer, stop = _trainer(stretch, lesson.activity, config), threading.Event()
    if lesson.epochs:
        restore(trainer, lesson.state, lesson.epochs, traverses)
    for epoch in range(lesson.epochs, config.learning.epochs):
        _epoch(trainer, stretch, 0, epoch, images, config, len(config.views.views), None, stop)
    return trainer.state()


def traverses_shown(config: Config, epoch: int, traverses: int) -> int:
    """Number of the ``traverses`` that an epoch shows: while neurons compete for places, only the first."""
    settings = as_integer_config(config)
    competing = settings is not None and epoch < settings.learning.competing
    return 1 if competing else traverses


def presentations(config: Config, places: int, traverses: int, epochs: int) -> int:
    """Training presentations of ``places`` places in all views in the first ``epochs`` epochs."""
    return places * len(config.views.views) * sum(traverses_shown(config, epoch, traverses) for epoch in range(epochs))


def _epoch(
    trainer: StretchTrainer,
    stretch: Stretch,
    number: int,
    epoch: int,
    images: Images,
    config: Config,
    views: int,
    progress: Shown | None,
    stop: threading.Event,
) -> bool:
    """Show the images of one stretch in its view, first traverse first; False if training was stopped.

    After the last epoch neurons without a place are recruited for places without a neuron.
    """
    counts = np.zeros((stretch.places, stretch.neurons), np.int64)
    shown, references = 0, len(images.rates) * views
    trainer.begin_epoch(epoch)
    traverses = traverses_shown(config, epoch, len(images.rates))

    def present(traverse: int, place: int, times: int = 0) -> NDArray[Any]:
        shown_as = traverse * views + stretch.view  # its number among all references
        image = int(images.keys[traverse][place])
        key = presentation_key(config.seed, "train", image, epoch * references + shown_as)
        return trainer.present(images.rates[traverse][place], key_again(key, times), place, epoch)

    def again(place: int, times: int) -> NDArray[Any] | None:
        if stop.is_set():
            return None
        return np.sum([present(traverse, place, times) for traverse in range(traverses)], axis=0)

    for traverse in range(traverses):
        for place in range(stretch.places):
            if stop.is_set():
                return False
            counts[place] += present(traverse, place)
            shown += 1
            if progress is not None:
                progress(_progress(number, epoch, shown, counts, shown == stretch.places * traverses))
    settings, thresholds = as_integer_config(config), trainer.thresholds()
    if settings is None or thresholds is None or epoch < config.learning.epochs - 1:
        return True
    return recruit(thresholds, counts, rounds(settings.learning), again)


def _progress(number: int, epoch: int, shown: int, counts: NDArray[np.int64], whole: bool) -> Progress:
    """Figures of one stretch; those that take time to compute only at the end of an epoch (else -1)."""
    if not whole:
        return Progress(number, epoch, shown, -1.0, -1, -1)
    used, covered = coverage(counts.T)
    return Progress(number, epoch, shown, float(counts.sum() / shown), used, covered)


Advance = Callable[[int, str], None]
"""Function that advances a progress bar by a number, with a note beside it."""


def _unseen(by: int, note: str) -> None:
    """Move no bar."""


def epochs_done(done: dict[int, int], epochs: int, stretches: int) -> str:
    """One line on the progress of training: how many of ``stretches`` have finished all ``epochs``, and the epochs of a
    few others, from ``done``."""
    begun = [f"stretch {k + 1}: {epoch} of {epochs}" for k, epoch in sorted(done.items()) if epoch < epochs]
    named = ", ".join(begun[:3]) + (f" and {len(begun) - 3} more" if len(begun) > 3 else "")
    finished = f"stretches finished: {len(done) - len(begun)} of {stretches}"
    return "; ".join(
        [*([f"epochs done: {named}"] if begun else []), *([finished] if stretches > 1 or not begun else [])]
    )


@dataclass(frozen=True)
class Monitor:
    """Callbacks that report on a training; by default each shows nothing.

    Attributes:
        line: Takes a line of text: a note on what is learned.
        bar: Makes a bar of a text and a total, for as long as a ``with`` block takes; it is moved by an `Advance`.
        stage: Shows a text for as long as a ``with`` block takes.
    """

    line: Callable[[str], object] = lambda text: None
    bar: Callable[[str, int], AbstractContextManager[Advance]] = lambda text, total: nullcontext(_unseen)
    stage: Callable[[str], AbstractContextManager[object]] = lambda text: nullcontext()


UNSEEN = Monitor()
"""Shows nothing."""


class LearningBar(NamedTuple):
    """A bar over all training presentations.

    Attributes:
        show: Takes `Progress`, from any thread.
        resumed: Takes the epochs done of each stretch before this run.
    """

    show: Callable[[Progress], None]
    resumed: Callable[[dict[int, int]], None]


@contextmanager
def learning_bar(
    monitor: Monitor,
    stretches: Sequence[Stretch],
    config: Config,
    traverses: int,
    *,
    here: bool = True,
    checkpoint: Path | None = None,
) -> Iterator[LearningBar]:
    """A bar that shows spikes per image, neurons used and places covered of the ``stretches`` that learn.

    Args:
        monitor: Makes the bar.
        stretches, config, traverses: What learns, with which settings, from how many traverses.
        here: Whether it learns in this process; a cluster has a bar of its own.
        checkpoint: Checkpoint from which training resumes.
    """
    epochs, views = config.learning.epochs, len(config.views.views)
    places = sum(stretch.places for stretch in stretches) // views
    lock = threading.Lock()
    pending = [0, time.monotonic()]
    total = presentations(config, places, traverses, epochs)
    with monitor.bar("learning", total) if here else nullcontext(_unseen) as advance:

        def show(state: Progress) -> None:
            with lock:
                pending[0] += 1
                now = time.monotonic()
                if state.neurons_used < 0 and now - pending[1] < 0.1:
                    return
                note = ""
                if state.neurons_used >= 0:
                    part = stretches[state.stretch]
                    where = f"stretch {state.stretch + 1}/{len(stretches)}, " if len(stretches) > 1 else ""
                    note = (
                        f"{where}epoch {state.epoch + 1}/{epochs}: {state.spikes_per_image:.1f} spikes/image, "
                        f"{state.neurons_used}/{part.neurons} neurons, {state.places_covered}/{part.places} places"
                    )
                advance(int(pending[0]), note)
                pending[0], pending[1] = 0, now

        def resumed(done: dict[int, int]) -> None:
            before = sum(presentations(config, stretches[k].places, traverses, epoch) for k, epoch in done.items())
            advance(before // views, "")
            monitor.line(f"resuming from {shown(checkpoint or '')}; {epochs_done(done, epochs, len(stretches))}")

        yield LearningBar(show, resumed)
