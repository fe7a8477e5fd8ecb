"""From what stretches learned to a whole model: joined, quantised, and its responses to the references measured.

What a stretch learns depends on its own images, the settings and the seed alone. All that depends on the others, what
neurons share, the scale, biases, thresholds and responses, is derived here, in the same way after every training,
extension, removal and merger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference import quantise
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import InputError
from lava_vpr.gate import integer_config
from lava_vpr.inputs.encoded import Keep
from lava_vpr.inputs.encoder import INPUTS, EncoderConfig
from lava_vpr.inputs.vectors import Standard
from lava_vpr.model import Model, Stretch
from lava_vpr.positions.frames import Positions
from lava_vpr.settings.conductance import ConductanceLearning
from lava_vpr.storage.arrays import narrow
from lava_vpr.training.references import coverage, reference_responses, shown_references

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True)
class LearnedRoute:
    """The places of a model, and what is kept of their images.

    Attributes:
        references: Traverses of the same places, each in all views, view after view.
        images: Images in the whole first traverse.
        positions: Where the first traverse's images were taken; None if that is unknown.
        standard: What vectors are measured by; None of images.
    """

    references: Sequence[EncodedTraverse]
    images: int
    positions: Positions | None = None
    standard: Standard | None = None

    def check(self, encoder: EncoderConfig) -> None:
        """Refuse references that a model of these settings could not keep, before hours of work.

        Raises:
            InputError: they were encoded without patches, vectors or thumbnails, or without what vectors are measured
                by, or there is not one position for each place.
        """
        row = INPUTS[encoder.kind]
        for reference in self.references:
            _ = (
                reference.kept(Keep.VECTORS, "training")
                if row.sees == "vector"
                else reference.kept(Keep.PATCHES, "training")
            )
        if row.standardised != (self.standard is not None):
            raise InputError("training needs what vectors were measured by, and of nothing else; give it with them")
        self.references[0].kept(Keep.THUMBNAILS, "training")
        places = len(self.references[0])
        if self.positions is not None and len(self.positions) != places:
            raise InputError(f"there are {len(self.positions)} positions for {places} places; give one for each")


def in_one(parts: Sequence[NDArray[T] | None]) -> NDArray[T] | None:
    """All parts, one after another; None where one has none."""
    own = [part for part in parts if part is not None]
    return np.concatenate(own) if len(own) == len(parts) else None


def integer_network(
    learned: NDArray[np.float32], config: Config, stretches: Sequence[Stretch], activity: NDArray[np.float32]
) -> FixedNetwork:
    """The integer network of ``learned`` float weights (inputs, neurons).

    Args:
        learned: What the neurons of all stretches learned.
        config: Settings.
        stretches: The parts of the route.
        activity: Input responses to the references, traverse after traverse, float32 (images, inputs).
    Raises:
        ConfigError: the settings are those of the float conductance model, or nothing was learned.
        NetworkLimitError: it could overflow Loihi's registers.
    """
    network = integer_config(config, "quantising").network
    weights = quantise.distinctive(learned, network)
    return quantise.quantise(weights, network, shown_references(stretches, activity, config))


def joined(
    learned: NDArray[np.float32],
    config: Config,
    stretches: tuple[Stretch, ...],
    route: LearnedRoute,
    pool: Pool,
) -> Model:
    """The model of what its stretches learned: quantised as a whole, its responses measured.

    Args:
        learned: Float weights of all stretches' neurons, float32 (inputs, neurons).
        config: Settings of an integer network.
        stretches: The parts of the route, view after view.
        route: The references, checked.
        pool: Who measures the responses; it changes nothing.
    Raises:
        ConfigError, NetworkLimitError: as `integer_network`.
    """
    activity = np.concatenate([reference.activity for reference in route.references])
    network = integer_network(learned, config, stretches, activity)
    responses = reference_responses(network, route.references, config, pool)
    return model_of(network, learned, responses, config, stretches, route)


def model_of(
    network: FixedNetwork | ConductanceState,
    learned: NDArray[np.float32],
    responses: NDArray[Any],
    config: Config,
    stretches: tuple[Stretch, ...],
    route: LearnedRoute,
) -> Model:
    """A model with its figures and all that it keeps of ``route``; the other arguments are its fields."""
    references, positions = route.references, route.positions
    first, places = references[0], len(references[0])
    used, covered = coverage(responses)
    learning = config.learning
    repeats = min(learning.label_epochs, learning.epochs) if isinstance(learning, ConductanceLearning) else 1
    return Model(
        config=config,
        network=network,
        learned=learned,
        responses=narrow(responses),
        stretches=stretches,
        place_indices=first.indices,
        place_names=first.names,
        route_images=route.images,
        labels=np.tile(np.arange(places), len(references)),
        patches=in_one([reference.patches for reference in references]),
        activity=np.concatenate([reference.activity for reference in references]),
        thumbnails=first.kept(Keep.THUMBNAILS, "training"),
        hog=in_one([reference.hog for reference in references]),
        vectors=in_one([reference.vectors for reference in references]),
        standard=route.standard,
        positions=None if positions is None else positions.values,
        frame=None if positions is None else positions.frame,
        training={
            "spikes_per_image": float(responses.sum() / (places * repeats * len(references))),
            "neurons_used": used,
            "places_covered": covered,
        },
    )
