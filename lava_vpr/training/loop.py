"""The training loop: a route cut into stretches, which learn in parallel, with checkpoints."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse, training_rates
from lava_vpr.engine import effort
from lava_vpr.engine.inference import quantise
from lava_vpr.engine.learning import integer, stdp
from lava_vpr.engine.learning.recruiting import key_again, recruit, rounds
from lava_vpr.engine.random import image_keys, presentation_key, stretch_key
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.gate import as_integer_config, integer_config
from lava_vpr.inputs.vectors import Standard
from lava_vpr.model import Model, Stretch
from lava_vpr.modelfile import check_model
from lava_vpr.positions.frames import Positions
from lava_vpr.slayer import needs
from lava_vpr.training.checkpoint import Checkpoint, fingerprint
from lava_vpr.training.door import check_encoded_references
from lava_vpr.training.joining import Route, joined, model_of
from lava_vpr.training.references import coverage
from lava_vpr.training.trainers import ConductanceTrainer, StretchTrainer, trainer_of


@dataclass(frozen=True)
class Progress:
    """Progress of one stretch; ``neurons_used`` and ``places_covered`` speak of its last whole epoch."""

    stretch: int
    epoch: int
    presentations: int
    spikes_per_image: float
    neurons_used: int
    places_covered: int


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
    learning = settings.learning
    quantise.check_steps(settings.network, sum(stretch.neurons for stretch in stretches))
    if learning.rule == "slayer":
        needs.require()
    if learning.rule != "stdp":
        uneven = next((part for part in stretches if part.neurons != part.places), None)
        if uneven is not None:
            raise ConfigError(
                f"learning.rule {learning.rule} takes one neuron for each place, but {uneven.places} places have "
                f"{uneven.neurons} neurons; set network.neurons to 0 and network.neurons_per_place to 1"
            )
    elif learning.arithmetic == "integer":
        integer.phases(learning, config.encoder.inputs, config.encoder.train_spikes)
    return stretches


def train(
    references: Sequence[EncodedTraverse],
    config: Config,
    *,
    route_images: int | None = None,
    positions: Positions | None = None,
    standard: Standard | None = None,
    parts: Sequence[int] = (),
    jobs: int = 1,
    checkpoint: Path | None = None,
    interval: float = 2.0,
    resume: bool = False,
    progress: Callable[[Progress], None] | None = None,
    resumed: Callable[[dict[int, int]], None] | None = None,
) -> Model:
    """Learn the places of a route.

    Args:
        references: One or more traverses of the same places, each in all views of ``config.views``, view after view
            (`lava_vpr.encoding.encode_views`).
        config: Settings; equal settings and images give the bit-identical model whatever ``jobs``.
        route_images: Images in the whole first traverse (default: up to the last place).
        positions: Where the first traverse's images were taken, one for each place; None if that is unknown.
        standard: What vectors were measured by when they were encoded; None of images.
        parts: Numbers of places in a row, each part of the route cut into stretches by itself; none: the whole route is
            one part. Training parts together gives the model that training each and `lava_vpr.maps.merge` gives.
        jobs: Threads; each learns one stretch at a time.
        checkpoint: Where to keep checkpoints; None keeps none.
        interval: Least seconds between two checkpoints.
        resume: Go on from ``checkpoint``.
        progress: Called after every presentation, from any thread.
        resumed: Function that is told the epochs done per stretch when training resumes.
    Raises:
        ConfigError: the settings cannot be learned, or model or training would cost more than the limits allow.
        InputError: references do not match each other or the settings.
        ModelFileError: the checkpoint cannot be used or written.
        NetworkLimitError: the trained network could overflow.
    """
    route = Route(references, check_encoded_references(references, config, route_images), positions, standard)
    route.check(config.encoder)
    traverses = len(references) // len(config.views.views)
    stretches = check_size(len(references[0]), config, traverses, parts)
    store = Checkpoint(checkpoint, fingerprint(references, config, stretches), interval)
    trainers = trainers_of(stretches, references, config)
    if resume:
        store.load(trainers, config.learning.epochs, traverses)
        if resumed is not None:
            resumed(dict(store.epochs))
    learn(trainers, stretches, references, config, jobs=jobs, store=store, progress=progress)
    try:
        if isinstance(trainers[0], ConductanceTrainer):
            network, responses = trainers[0].network, trainers[0].responses
            return model_of(network, np.zeros((0, 0), np.float32), responses, config, stretches, route)
        return joined(learned_weights(trainers, config), config, stretches, route, jobs)
    except (ConfigError, NetworkLimitError):
        # Only other settings help, and those cannot go on from here.
        if checkpoint is not None:
            checkpoint.unlink(missing_ok=True)
        raise


def presented_keys(references: Sequence[EncodedTraverse], config: Config) -> list[NDArray[np.uint64]]:
    """The image key of each reference as training shows it, uint64 (places,), of each of ``references``."""
    return [image_keys(training_rates(reference.activity, config)) for reference in references]


def start_key(stretch: Stretch, keys: Sequence[NDArray[np.uint64]]) -> int:
    """The key that start weights of ``stretch`` are drawn for: that of its places' images in the first traverse.

    Args:
        stretch: The stretch.
        keys: `presented_keys`.
    """
    return stretch_key(keys[stretch.view][stretch.first_place : stretch.first_place + stretch.places])


def trainers_of(
    stretches: Sequence[Stretch], references: Sequence[EncodedTraverse], config: Config
) -> list[StretchTrainer]:
    """A new trainer for each of ``stretches``."""
    keys, views = presented_keys(references, config), len(config.views.views)

    def shown(part: Stretch) -> NDArray[np.float32]:
        places = slice(part.first_place, part.first_place + part.places)
        return np.concatenate([reference.activity[places] for reference in references[part.view :: views]])

    return [trainer_of(config, part, start_key(part, keys), shown(part)) for part in stretches]


def learned_weights(trainers: Sequence[StretchTrainer], config: Config) -> NDArray[np.float32]:
    """What the stretches of an integer network learned, float32 (inputs, neurons).

    Each neuron's mean is normalised, but for weights that gradients gave a sign.
    """
    parts = [trainer.state()["weights"].astype(np.float32) for trainer in trainers]
    learning = integer_config(config, "learned_weights").learning
    for part in parts if learning.rule != "slayer" else ():
        stdp.normalise(part, learning.mean_weight)
    return np.concatenate(parts, axis=1)


def learn(
    trainers: Sequence[StretchTrainer],
    stretches: Sequence[Stretch],
    references: Sequence[EncodedTraverse],
    config: Config,
    *,
    jobs: int = 1,
    store: Checkpoint | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> None:
    """Let the trainers of all ``stretches`` learn; each sees the images of its own stretch and nothing of the others.

    Args:
        trainers, stretches: The trainer of each stretch, which is changed.
        references, config, jobs, progress: As in `train`.
        store: Where training stands; None: at its start, and no checkpoint is kept.
    """
    store = Checkpoint(None, "") if store is None else store
    rates = [training_rates(reference.activity, config) for reference in references]
    keys = [image_keys(some) for some in rates]
    stop = threading.Event()

    def learn_one(number: int) -> None:
        stretch, trainer = stretches[number], trainers[number]
        for epoch in range(store.epochs.get(number, 0), config.learning.epochs):
            if not _epoch(trainer, stretch, number, epoch, rates, keys, config, progress, stop):
                return
            store.update(number, epoch + 1, trainer.state())

    _run(learn_one, len(stretches), jobs, stop, store)


def _run(learn: Callable[[int], None], stretches: int, jobs: int, stop: threading.Event, store: Checkpoint) -> None:
    """Learn every stretch, on ``jobs`` threads; an interrupt or error stops all and saves what is known."""

    def guarded(number: int) -> None:
        try:
            learn(number)
        except BaseException:
            stop.set()  # at once, before a thread takes up the next stretch
            raise

    with ThreadPoolExecutor(max(1, min(jobs, stretches))) as pool:
        futures = [pool.submit(guarded, number) for number in range(stretches)]
        try:
            pending = set(futures)
            while pending:  # a finite wait lets Ctrl-C through
                done, pending = wait(pending, timeout=0.2, return_when=FIRST_EXCEPTION)
                for future in done:
                    future.result()
        except BaseException:
            stop.set()
            for future in futures:
                future.cancel()
            wait(futures)
            store.flush()
            raise


def traverses_shown(config: Config, epoch: int, traverses: int) -> int:
    """The number of ``traverses`` that an epoch shows: while neurons compete for places, the first alone."""
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
    rates: Sequence[NDArray[Any]],
    keys: Sequence[NDArray[np.uint64]],
    config: Config,
    progress: Callable[[Progress], None] | None,
    stop: threading.Event,
) -> bool:
    """Show the images of one stretch in its view, first traverse first; False if training was stopped.

    After the last epoch neurons without a place are recruited for places without a neuron.
    """
    counts = np.zeros((stretch.places, stretch.neurons), np.int64)
    shown = 0
    trainer.begin_epoch(epoch)
    views = len(config.views.views)
    traverses = traverses_shown(config, epoch, len(rates) // views)
    in_view = range(stretch.view, traverses * views, views)

    def present(shown_as: int, place: int, times: int = 0) -> NDArray[Any]:
        image = stretch.first_place + place
        key = presentation_key(config.seed, "train", int(keys[shown_as][image]), epoch * len(rates) + shown_as)
        return trainer.present(rates[shown_as][image], key_again(key, times), place, epoch)

    def again(place: int, times: int) -> NDArray[Any] | None:
        if stop.is_set():
            return None
        return np.sum([present(shown_as, place, times) for shown_as in in_view], axis=0)

    for shown_as in in_view:
        for place in range(stretch.places):
            if stop.is_set():
                return False
            counts[place] += present(shown_as, place)
            shown += 1
            if progress is not None:
                progress(_progress(number, epoch, shown, counts, shown == stretch.places * traverses))
    settings, thresholds = as_integer_config(config), trainer.thresholds()
    if settings is None or thresholds is None or epoch < config.learning.epochs - 1:
        return True
    return recruit(thresholds, counts, rounds(settings.learning), again)


def _progress(number: int, epoch: int, shown: int, counts: NDArray[np.int64], whole: bool) -> Progress:
    """Figures of one stretch; those that cost time only at the end of an epoch (else -1)."""
    if not whole:
        return Progress(number, epoch, shown, -1.0, -1, -1)
    used, covered = coverage(counts.T)
    return Progress(number, epoch, shown, float(counts.sum() / shown), used, covered)
