"""Whether learning paid: a learned network beside what learned nothing, on altered references.

Network, templates and the cosine of the inputs are asked for the same references, altered as for the calibration of
probabilities (`lava_vpr.training.measuring`); of a long map, for those of its first `PLACES` places, as a map of their
own.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.engine.inference.direct import strengths
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import LavaVprError
from lava_vpr.maps.changes import remove
from lava_vpr.matching.baselines import cosine_similarities
from lava_vpr.matching.decoders import best
from lava_vpr.matching.probability import RIGHT
from lava_vpr.model import IntegerModel, Model, as_integer
from lava_vpr.training.measuring import answered, on_map, scores_of
from lava_vpr.training.templates import template_of

PLACES, REPEATS = 200, 2
DEVIATIONS = 3.0
"""The network is behind where the references that only another finds are more than those that only it finds, by so
many standard deviations of what chance alone makes of their difference."""


class Compared(NamedTuple):
    """Which altered references are found by the network, its templates and the cosine of its inputs, each bool (n,)."""

    network: NDArray[np.bool_]
    template: NDArray[np.bool_]
    cosine: NDArray[np.bool_]

    @property
    def said(self) -> str | None:
        """A sentence with how many each finds; None: the network is not behind."""
        ahead = [self._ahead(self.template), self._ahead(self.cosine)]
        if not any(ahead):
            return None
        own, template, cosine = (f"{int(found.sum()):,}" for found in self)
        remedy = "--learning template may serve better" if ahead[0] else "compare them by lava-vpr eval"
        return (
            f"the learned network finds {own} of {len(self.network):,} altered references, its templates {template}, "
            f"the cosine of its inputs {cosine}: {remedy} here"
        )

    def _ahead(self, other: NDArray[np.bool_]) -> bool:
        more = int(other.sum()) - int(self.network.sum())
        return more > DEVIATIONS * math.sqrt(np.count_nonzero(other != self.network))


def compared(model: Model, pool: Pool = ONE_THREAD) -> Compared | None:
    """What a network and what learned nothing find of its references, altered.

    Args:
        model: A model as it was learned.
        pool: Who asks the networks; it changes nothing.
    Returns:
        None: its network is no integer one, or a neuron for each place costs more than the limits allow.
    """
    learned = as_integer(model)
    if learned is None:
        return None
    if learned.places > PLACES:
        learned = remove(learned, learned.place_indices[PLACES:].tolist(), pool=pool)
    try:
        template = template_of(learned, pool)
    except LavaVprError:
        return None
    asked = on_map(learned)[:REPEATS]

    def found(network: IntegerModel) -> NDArray[np.bool_]:
        own = [one._replace(scores=partial(scores_of, network, network.responses)) for one in asked]
        return answered(network, own, pool)[:, 1] == RIGHT

    direct = learned.config.encoder.direct is not None
    references = strengths(query_rates(learned.activity, learned.config), direct)
    shown = [strengths(one.block().rates, direct) for one in asked]
    likest = [
        best(cosine_similarities(references, rates, learned.labels)) == one.places
        for one, rates in zip(asked, shown, strict=True)
    ]
    return Compared(found(learned), found(template), np.concatenate(likest))
