"""The queries of a run, with what every stage needs of them, worked out once."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.host import HostBackend
from lava_vpr.backends.interface import Presentations, query_presentations
from lava_vpr.cluster.tasks import Pool
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.presentations import Trains, cores
from lava_vpr.model import Model


@dataclass(frozen=True)
class QuerySet:
    """The queries of a run, and the model that is asked.

    Attributes:
        model: The model that is asked.
        images: The query images, encoded with its settings.
        shown: The presentations that every backend is shown of them: input rates and noise.
    """

    model: Model = field(repr=False)
    images: EncodedTraverse = field(repr=False)
    shown: Presentations = field(repr=False)

    @classmethod
    def of(cls, model: Model, images: EncodedTraverse, seed: int | None = None) -> QuerySet:
        """The queries ``images`` to ``model``, with the noise of ``seed``; None: of the model's own.

        Raises:
            InputError: the queries were encoded with other settings.
        """
        return cls(model, images, query_presentations(model, images, seed))

    def __len__(self) -> int:
        return len(self.images)

    def trains(self, chosen: slice | NDArray[np.int64]) -> Trains:
        """Every spike of the queries ``chosen``, by the host engine.

        Raises:
            ConfigError: the model has no integer network.
        """
        return HostBackend(Pool(cores())).trains(self.model, self.shown.part(chosen))
