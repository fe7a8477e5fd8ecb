"""The training loop: a route cut into stretches, which learn in parallel, with checkpoints; joined to a whole model.

What a stretch learns depends only on its own images, the settings and the seed. Everything that depends on other
stretches (what neurons share, the scale, biases, thresholds, responses) is derived afterwards (`joined`), in the same
way after every training, extension, removal and merger.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import Config, as_integer_config, integer_config
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine import effort
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference import quantise
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.learning import stdp
from lava_vpr.errors import ConfigError, InputError, NetworkLimitError
from lava_vpr.inputs.encoder import INPUTS, EncoderConfig, Keep
from lava_vpr.inputs.vectors import Standard
from lava_vpr.model import Model, Stretch
from lava_vpr.modelfile import check_model
from lava_vpr.positions.frames import Positions
from lava_vpr.settings.conductance import ConductanceLearning
from lava_vpr.storage.arrays import narrow
from lava_vpr.training.checkpoint import Checkpoint, fingerprint
from lava_vpr.training.measuring import coverage, reference_responses, shown_references
from lava_vpr.training.preparing import check_encoded_references
from lava_vpr.training.stretches import Shown, learn, presentations, trainers_of
from lava_vpr.training.trainers import ConductanceTrainer, StretchTrainer, rule_of


def split(places: int, config: Config, parts: Sequence[int] = ()) -> tuple[Stretch, ...]:
    """Cut a route of ``places`` into the fewest stretches of at most ``config.stretch`` places, as even as can be.

    Every view has stretches of its own, view after view.

    Args:
        places: Number of places.
        config: Settings.
        parts: Numbers of consecutive places; each such part is cut separately. Empty: the whole route is one part.
    Raises:
        ConfigError: the parts are not the route.
    """
    if parts and (min(parts) < 1 or sum(parts) != places):
        raise ConfigError(
            f"parts of {', '.join(map(str, parts))} places are {sum(parts)} of a route of {places}; give parts of at "
            "least 1 place that are as many together"
        )
    bounds = [0]
    for part in parts or (places,):
        cuts = 1 if config.stretch == 0 else -(-part // config.stretch)
        bounds += [bounds[-1] + end for end in (round(part * k / cuts) for k in range(1, cuts + 1))]
    stretches, neuron = [], 0
    for view in range(len(config.views.views)):
        for first, end in itertools.pairwise(bounds):
            neurons = config.neurons_for(end - first)
            stretches.append(Stretch(first, end - first, neuron, neurons, view))
            neuron += neurons
    return tuple(stretches)


def check_size(places: int, config: Config, traverses: int = 1, parts: Sequence[int] = ()) -> tuple[Stretch, ...]:
    """Cut a route of ``places``, shown in ``traverses``, into stretches, and check size and cost before training.

    ``parts`` are those of `split`.

    Raises:
        ConfigError: stretches for a model that cannot be joined; presentations too short for so many neurons; a model,
            a query or a training that would cost more than the limits allow.
        NetworkLimitError: integer learning that could overflow.
    """
    stretches = split(places, config, parts)
    check_whole(config, places, traverses, sum(stretch.neurons for stretch in stretches))
    shown = presentations(config, places, traverses, config.learning.epochs)
    effort.check_training(config, max(stretch.neurons for stretch in stretches), shown)
    return check_network(places, config, parts)


def check_whole(config: Config, places: int, traverses: int, neurons: int) -> None:
    """Refuse a model of too many places and neurons before it is made.

    Raises:
        ConfigError: presentations too short for so many neurons; a model or query that would cost more than the limits
            allow.
    """
    check_model(config, places, traverses * len(config.views.views), neurons)
    effort.check_query(config, neurons)
    settings = as_integer_config(config)
    if settings is not None:
        quantise.check_steps(settings.network, neurons)


def check_network(places: int, config: Config, parts: Sequence[int] = ()) -> tuple[Stretch, ...]:
    """Cut a route of ``places`` into stretches, and check that their numbers fit the arithmetic; cost is not checked.

    ``parts`` are those of `split`.

    Raises:
        ConfigError: stretches for a model that cannot be joined; presentations too short for so many neurons.
        NetworkLimitError: integer learning that could overflow.
    """
    stretches = split(places, config, parts)
    settings = as_integer_config(config)
    if settings is None:
        if len(stretches) > 1:
            raise ConfigError("the conductance model learns a route in one network; use --stretch 0")
        return stretches
    rule = rule_of(config)
    quantise.check_steps(settings.network, sum(stretch.neurons for stretch in stretches))
    rule.check(settings)
    if rule.neuron_a_place:
        uneven = next((part for part in stretches if part.neurons != part.places), None)
        if uneven is not None:
            raise ConfigError(
                f"learning.rule {rule.name} takes one neuron for each place, but {uneven.places} places have "
                f"{uneven.neurons} neurons; set network.neurons to 0 and network.neurons_per_place to 1"
            )
    return stretches


def train(
    references: Sequence[EncodedTraverse],
    config: Config,
    *,
    route_images: int | None = None,
    positions: Positions | None = None,
    standard: Standard | None = None,
    parts: Sequence[int] = (),
    pool: Pool = ONE_THREAD,
    checkpoint: Path | None = None,
    interval: float = 2.0,
    resume: bool = False,
    progress: Shown | None = None,
    resumed: Callable[[dict[int, int]], None] | None = None,
) -> Model:
    """Learn the places of a route.

    Args:
        references: One or more traverses of the same places, each in all views of ``config.views``, view after view
            (`lava_vpr.encoding.encode_views`).
        config: Settings; equal settings and images give the bit-identical model whatever ``pool``.
        route_images: Images in the whole first traverse (default: up to the last place).
        positions: Positions of the first traverse's images, one for each place; None if unknown.
        standard: Standard by which vectors were encoded; None for images.
        parts: Numbers of places in a row, each part of the route cut into stretches by itself; none: the whole route is
            one part. Training parts together gives the model that training each and `lava_vpr.maps.merge` gives.
        pool: Threads or cluster that learn the stretches, one per thread, and measure responses.
        checkpoint: Where to keep checkpoints; None keeps none.
        interval: Least seconds between two checkpoints.
        resume: Whether to continue from ``checkpoint``.
        progress: Called after every presentation, from any thread; on a cluster, with the state of the tasks.
        resumed: Function called with the epochs done per stretch when training resumes.
    Raises:
        ConfigError: the settings cannot be learned, or model or training would cost more than the limits allow.
        InputError: references do not match each other or the settings.
        ClusterError: the cluster was lost; stretches that had come back are in the checkpoint.
        ModelFileError: the checkpoint cannot be used or written.
        NetworkLimitError: the trained network could overflow.
    """
    route = LearnedRoute(references, check_encoded_references(references, config, route_images), positions, standard)
    route.check(config.encoder)
    traverses = len(references) // len(config.views.views)
    stretches = check_size(len(references[0]), config, traverses, parts)
    store = Checkpoint(checkpoint, fingerprint(references, config, stretches), interval)
    trainers = trainers_of(stretches, references, config)
    if resume:
        store.load(trainers, config.learning.epochs, traverses)
        if resumed is not None:
            resumed(dict(store.epochs))
    learn(trainers, stretches, references, config, pool=pool, store=store, progress=progress)
    try:
        if isinstance(trainers[0], ConductanceTrainer):
            network, responses = trainers[0].network, trainers[0].responses
            return model_of(network, np.zeros((0, 0), np.float32), responses, config, stretches, route)
        return joined(learned_weights(trainers, config), config, stretches, route, pool)
    except (ConfigError, NetworkLimitError):
        # Only other settings help, and those cannot resume from this checkpoint.
        if checkpoint is not None:
            checkpoint.unlink(missing_ok=True)
        raise


def learned_weights(trainers: Sequence[StretchTrainer], config: Config) -> NDArray[np.float32]:
    """What the stretches of an integer network learned, float32 (inputs, neurons).

    Each neuron's mean is normalised, except where gradients have made weights signed.
    """
    parts = [trainer.state()["weights"].astype(np.float32) for trainer in trainers]
    learning = integer_config(config, "learned_weights").learning
    for part in parts if not rule_of(config).signed else ():
        stdp.normalise(part, learning.mean_weight)
    return np.concatenate(parts, axis=1)


T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True)
class LearnedRoute:
    """The places of a model, and the data of their images that it stores.

    Attributes:
        references: Traverses of the same places, each in all views, view after view.
        images: Images in the whole first traverse.
        positions: Where the first traverse's images were taken; None if that is unknown.
        standard: Standard by which vectors are encoded; None for images.
    """

    references: Sequence[EncodedTraverse]
    images: int
    positions: Positions | None = None
    standard: Standard | None = None

    def check(self, encoder: EncoderConfig) -> None:
        """Refuse references that a model of these settings could not keep, before hours of work.

        Raises:
            InputError: they were encoded without patches, vectors or thumbnails, or without a standard for vectors, or
                places and positions are not equally many.
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
    shown = shown_references(stretches, activity, config)
    return quantise.quantise(quantise.distinctive(learned, network, shown), network, shown, config.encoder)


def joined(
    learned: NDArray[np.float32],
    config: Config,
    stretches: tuple[Stretch, ...],
    route: LearnedRoute,
    pool: Pool,
) -> Model:
    """The model made from what its stretches learned: quantised as a whole, with measured responses.

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
    responses = reference_responses(network, activity, len(route.references[0]), config, pool)
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
