"""The training loop: stretches in parallel, checkpoints, and the frozen network's responses to the references."""

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

from lava_vpr.config import ConductanceLearning, Config
from lava_vpr.encoding import EncodedTraverse, training_rates
from lava_vpr.engine import effort
from lava_vpr.engine.conductance import model as conductance
from lava_vpr.engine.inference import fixed, quantise
from lava_vpr.engine.learning import integer, stdp
from lava_vpr.engine.random import presentation_key
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.gate import as_integer_config, integer_config
from lava_vpr.model import Model, Stretch
from lava_vpr.modelfile import check_model
from lava_vpr.training.checkpoint import Checkpoint, fingerprint
from lava_vpr.training.door import check_encoded_references
from lava_vpr.training.references import coverage, reference_responses, shown_references
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


def split(places: int, config: Config) -> tuple[Stretch, ...]:
    """Cut a route of ``places`` into the fewest stretches of at most ``config.stretch`` places, as even as can be.

    Every view has stretches of its own, view after view.
    """
    parts = 1 if config.stretch == 0 else -(-places // config.stretch)
    bounds = [round(places * k / parts) for k in range(parts + 1)]
    stretches, neuron = [], 0
    for view in range(len(config.views.views)):
        for first, end in itertools.pairwise(bounds):
            neurons = config.neurons_for(end - first)
            stretches.append(Stretch(first, end - first, neuron, neurons, view))
            neuron += neurons
    return tuple(stretches)


def check_size(places: int, config: Config, traverses: int = 1) -> tuple[Stretch, ...]:
    """The stretches of a route of ``places``, shown in so many traverses, or a refusal before anything is learned.

    Raises:
        ConfigError: stretches for a model that cannot be joined; presentations too short for so many neurons; a model,
            a query or a training that would cost more than the limits allow.
        NetworkLimitError: integer learning that could overflow.
    """
    stretches = split(places, config)
    neurons = sum(stretch.neurons for stretch in stretches)
    check_model(config, places, traverses * len(config.views.views), neurons)
    effort.check_query(config, neurons)
    shown = presentations(config, places, traverses, config.learning.epochs)
    effort.check_training(config, max(stretch.neurons for stretch in stretches), shown)
    return check_network(places, config)


def check_network(places: int, config: Config) -> tuple[Stretch, ...]:
    """The stretches of a route of ``places``, or a refusal of what no arithmetic holds; what it costs is not asked.

    Raises:
        ConfigError: stretches for a model that cannot be joined; presentations too short for so many neurons.
        NetworkLimitError: integer learning that could overflow.
    """
    stretches = split(places, config)
    neurons = sum(stretch.neurons for stretch in stretches)
    settings = as_integer_config(config)
    if settings is None:
        if len(stretches) > 1:
            raise ConfigError("the conductance model learns a route in one network; use --stretch 0")
        return stretches
    learning = settings.learning
    quantise.check_steps(settings.network, neurons)
    if learning.rule == "template":
        uneven = next((part for part in stretches if part.neurons != part.places), None)
        if uneven is not None:
            raise ConfigError(
                f"learning.rule template takes one neuron for each place, but {uneven.places} places have "
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
    route_images = check_encoded_references(references, config, route_images)
    _kept(references)  # seen now, before hours of work
    traverses = len(references) // len(config.views.views)
    stretches = check_size(len(references[0]), config, traverses)
    trainers = [trainer_of(config, stretch, number) for number, stretch in enumerate(stretches)]
    store = Checkpoint(checkpoint, fingerprint(references, config), interval)
    if resume:
        store.load(trainers, config.learning.epochs, traverses)
        if resumed is not None:
            resumed(dict(store.epochs))
    rates = [training_rates(reference.activity, config) for reference in references]
    stop = threading.Event()

    def learn(number: int) -> None:
        stretch, trainer = stretches[number], trainers[number]
        for epoch in range(store.epochs.get(number, 0), config.learning.epochs):
            if not _epoch(trainer, stretch, number, epoch, references, rates, config, progress, stop):
                return
            store.update(number, epoch + 1, trainer.state())

    _run(learn, len(stretches), jobs, stop, store)
    try:
        return _finish(references, config, stretches, trainers, route_images, jobs)
    except (ConfigError, NetworkLimitError):
        # Only other settings help, and those cannot go on from here.
        if checkpoint is not None:
            checkpoint.unlink(missing_ok=True)
        raise


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
    references: Sequence[EncodedTraverse],
    rates: Sequence[NDArray[Any]],
    config: Config,
    progress: Callable[[Progress], None] | None,
    stop: threading.Event,
) -> bool:
    """Show the images of one stretch in its view, first traverse first; False if training was stopped."""
    counts = np.zeros((stretch.places, stretch.neurons), np.int64)
    shown = 0
    trainer.begin_epoch(epoch)
    views = len(config.views.views)
    traverses = traverses_shown(config, epoch, len(references) // views)
    for shown_as in range(stretch.view, traverses * views, views):
        for place in range(stretch.places):
            if stop.is_set():
                return False
            image = stretch.first_place + place
            index = int(references[shown_as].indices[image])
            key = presentation_key(config.seed, "train", index, epoch * len(references) + shown_as)
            counts[place] += trainer.present(rates[shown_as][image], key, place, epoch)
            shown += 1
            if progress is not None:
                progress(_progress(number, epoch, shown, counts, shown == stretch.places * traverses))
    return True


def _progress(number: int, epoch: int, shown: int, counts: NDArray[np.int64], whole: bool) -> Progress:
    """Figures of one stretch; those that cost time only at the end of an epoch (else -1)."""
    if not whole:
        return Progress(number, epoch, shown, -1.0, -1, -1)
    used, covered = coverage(counts.T)
    return Progress(number, epoch, shown, float(counts.sum() / shown), used, covered)


def _finish(
    references: Sequence[EncodedTraverse],
    config: Config,
    stretches: tuple[Stretch, ...],
    trainers: Sequence[StretchTrainer],
    route_images: int,
    jobs: int,
) -> Model:
    """The model of trained stretches: joined, quantised, its responses to the references measured."""
    network: fixed.FixedNetwork | conductance.ConductanceState
    activity = np.concatenate([reference.activity for reference in references])
    settings = as_integer_config(config)
    if settings is not None:
        parts = [trainer.state()["weights"].astype(np.float32) for trainer in trainers]
        for part in parts:
            stdp.normalise(part, settings.learning.mean_weight)
        learned = np.concatenate(parts, axis=1)
        network = integer_network(learned, config, stretches, activity)
        responses = reference_responses(network, references, config, jobs)
    else:
        if not isinstance(trainers[0], ConductanceTrainer):
            raise TypeError("the conductance model is learned by a ConductanceTrainer")
        learned, network, responses = np.zeros((0, 0), np.float32), trainers[0].network, trainers[0].responses
    used, covered = coverage(responses)
    places = len(references[0])
    patches, thumbnails, hog = _kept(references)
    return Model(
        config=config,
        network=network,
        learned=learned,
        responses=responses,
        stretches=stretches,
        place_indices=references[0].indices,
        place_names=references[0].names,
        route_images=route_images,
        labels=np.tile(np.arange(places), len(references)),
        patches=patches,
        activity=activity,
        thumbnails=thumbnails,
        hog=hog,
        training={
            "spikes_per_image": float(responses.sum() / (places * _response_presentations(config, references))),
            "neurons_used": used,
            "places_covered": covered,
        },
    )


def _kept(
    references: Sequence[EncodedTraverse],
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8] | None]:
    """What a model keeps of its references' looks: every patch, the first traverse's thumbnails, every HOG if it can.

    Raises:
        InputError: they were encoded without.
    """
    patches = [reference.patches_for("training") for reference in references]
    hogs = [reference.hog for reference in references if reference.hog is not None]
    hog = np.concatenate(hogs) if len(hogs) == len(references) else None
    return np.concatenate(patches), references[0].thumbnails_for("training"), hog


def _response_presentations(config: Config, references: Sequence[EncodedTraverse]) -> int:
    """The number of times that each place was shown to count its responses."""
    learning = config.learning
    repeats = min(learning.label_epochs, learning.epochs) if isinstance(learning, ConductanceLearning) else 1
    return repeats * len(references)


def integer_network(
    learned: NDArray[np.float32], config: Config, stretches: Sequence[Stretch], activity: NDArray[np.float32]
) -> fixed.FixedNetwork:
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
