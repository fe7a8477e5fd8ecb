"""How far learning has come: what follows a training, and a bar over all its presentations."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from lava_vpr.config import Config
from lava_vpr.model import Stretch
from lava_vpr.storage.text import shown
from lava_vpr.training.loop import presentations
from lava_vpr.training.stretches import Progress

Advance = Callable[[int, str], None]
"""Moves a bar: by so many, with a note beside it."""


def _unseen(by: int, note: str) -> None:
    """Move no bar."""


@dataclass(frozen=True)
class Monitor:
    """What follows a training; each part shows nothing unless it is given.

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
        checkpoint: Where a resumed training goes on from.
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
            finished = ", ".join(f"stretch {k + 1}: {epoch} of {epochs}" for k, epoch in sorted(done.items()))
            monitor.line(f"resuming from {shown(checkpoint or '')}; epochs done: {finished}")

        yield LearningBar(show, resumed)
