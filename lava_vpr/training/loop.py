"""The training loop: a route cut into stretches, which learn in parallel, with checkpoints."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine import effort
from lava_vpr.engine.inference import quantise
from lava_vpr.engine.learning import stdp
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.gate import as_integer_config, integer_config
from lava_vpr.inputs.vectors import Standard
from lava_vpr.model import Model, Stretch
from lava_vpr.modelfile import check_model
from lava_vpr.positions.frames import Positions
from lava_vpr.training.checkpoint import Checkpoint, fingerprint
from lava_vpr.training.door import check_encoded_references
from lava_vpr.training.joining import LearnedRoute, joined, model_of
from lava_vpr.training.stretches import Shown, learn, trainers_of, traverses_shown
from lava_vpr.training.trainers import ConductanceTrainer, StretchTrainer, rule_of


def split(places: int, config: Config, parts: Sequence[int] = ()) -> tuple[Stretch, ...]:
    """Cut a route of ``places`` into the fewest stretches of at most ``config.stretch`` places, as even as can be.

    Every view has stretches of its own, view after view.

    Args:
        places: Number of places.
        config: Settings.
        parts: Numbers of places in a row, each part of the route cut by itself; none: the whole route is one.
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
    """The stretches of a route of ``places``, shown in so many traverses, or a refusal before anything is learned.

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
    """Refuse a model of so many places and neurons, before it is made.

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
    """The stretches of a route of ``places``, or a refusal of what no arithmetic holds; what it costs is not asked.

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
        positions: Where the first traverse's images were taken, one for each place; None if that is unknown.
        standard: What vectors were measured by when they were encoded; None of images.
        parts: Numbers of places in a row, each part of the route cut into stretches by itself; none: the whole route is
            one part. Training parts together gives the model that training each and `lava_vpr.maps.merge` gives.
        pool: Who learns the stretches, a thread one at a time, and measures responses.
        checkpoint: Where to keep checkpoints; None keeps none.
        interval: Least seconds between two checkpoints.
        resume: Go on from ``checkpoint``.
        progress: Called after every presentation here, from any thread; of a cluster, it is told where tasks stand.
        resumed: Function that is told the epochs done per stretch when training resumes.
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
        # Only other settings help, and those cannot go on from here.
        if checkpoint is not None:
            checkpoint.unlink(missing_ok=True)
        raise


def learned_weights(trainers: Sequence[StretchTrainer], config: Config) -> NDArray[np.float32]:
    """What the stretches of an integer network learned, float32 (inputs, neurons).

    Each neuron's mean is normalised, but for weights that gradients gave a sign.
    """
    parts = [trainer.state()["weights"].astype(np.float32) for trainer in trainers]
    learning = integer_config(config, "learned_weights").learning
    for part in parts if not rule_of(config).signed else ():
        stdp.normalise(part, learning.mean_weight)
    return np.concatenate(parts, axis=1)


def presentations(config: Config, places: int, traverses: int, epochs: int) -> int:
    """Training presentations of ``places`` places in all views in the first ``epochs`` epochs."""
    return places * len(config.views.views) * sum(traverses_shown(config, epoch, traverses) for epoch in range(epochs))
