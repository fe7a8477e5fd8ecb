"""How far learning has come: a bar over all training presentations."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from lava_vpr.cli.common import progress_bar, stderr
from lava_vpr.config import Config
from lava_vpr.model import Stretch
from lava_vpr.storage.text import shown
from lava_vpr.training.loop import presentations
from lava_vpr.training.stretches import Progress


class LearningBar(NamedTuple):
    """A bar over all training presentations.

    Attributes:
        show: Takes `Progress`, from any thread.
        skip: Takes the epochs done of each stretch before this run.
        epochs: Epochs that a whole training has.
    """

    show: Callable[[Progress], None]
    skip: Callable[[dict[int, int]], None]
    epochs: int

    def resumed(self, checkpoint: Path) -> Callable[[dict[int, int]], None]:
        """What says that training goes on from ``checkpoint``, given the epochs done of each stretch."""

        def told(done: dict[int, int]) -> None:
            self.skip(done)
            finished = ", ".join(f"stretch {k + 1}: {epoch} of {self.epochs}" for k, epoch in sorted(done.items()))
            stderr.print(f"resuming from {shown(checkpoint)}; epochs done: {finished}")

        return told


def _nobody(by: int, note: str) -> None:
    """Who is told of progress that is shown elsewhere."""


@contextmanager
def learning_bar(
    stretches: Sequence[Stretch], config: Config, traverses: int, here: bool = True
) -> Iterator[LearningBar]:
    """A bar that tells spikes per image, neurons used and places covered of the ``stretches`` that learn.

    There is none if they do not learn ``here``: of a cluster, its own is shown.
    """
    epochs, views = config.learning.epochs, len(config.views.views)
    places = sum(stretch.places for stretch in stretches) // views
    lock = threading.Lock()
    pending = [0, time.monotonic()]
    with ExitStack() as bars:
        total = presentations(config, places, traverses, epochs)
        advance = bars.enter_context(progress_bar("learning", total)) if here else _nobody

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

        def skip(done: dict[int, int]) -> None:
            shown = sum(presentations(config, stretches[k].places, traverses, epoch) for k, epoch in done.items())
            advance(shown // views, "")

        yield LearningBar(show, skip, epochs)
