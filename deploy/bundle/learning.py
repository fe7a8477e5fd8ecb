"""What a Loihi 2 bundle holds of the network that learns: enough to train it again, on the host, in Lava or on a board.

Lava's library has one threshold for all neurons, no floor, no hold and no normalisation; `engine.learning.lava_order`
is learning without these. What is learned on the chip are unsigned weights, whatever ``network.signed``: the host takes
off what all neurons share when it quantises what was learned (`learned_on_chip`), and writes the signed weights back.

``learning/learning.json`` has the rule (as LearningDense takes it), the neurons, what the host does between
presentations, and the schedule; ``learning/rates.npy`` the reference images as they are shown. Each stretch of the
route has a network of its own, in ``learning/stretchNNN/``: start weights and thresholds, and for every presentation in
order its epoch, image and key.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import integer_config
from lava_vpr.deploy.bundle.compression import requantised
from lava_vpr.deploy.bundle.folder import AGAIN, ReadBundle, array_bytes, json_bytes
from lava_vpr.deploy.bundle.references import rates_of
from lava_vpr.engine.inference.quantise import mantissa_of
from lava_vpr.engine.learning import stdp
from lava_vpr.engine.learning.integer import initial_state
from lava_vpr.engine.learning.lava_order import (
    FACTOR_BITS,
    FoldedPhase,
    FoldedTrainer,
    folded_phases,
    library_seed,
)
from lava_vpr.engine.learning.recruiting import key_again, recruit, rounds
from lava_vpr.engine.learning.stdp import PlasticState
from lava_vpr.engine.random import image_keys, presentation_key, stretch_key
from lava_vpr.engine.rates import rates16
from lava_vpr.errors import BundleError, ConfigError, LavaVprError
from lava_vpr.loihi import TRACE_LIMIT, WEIGHT_LIMIT
from lava_vpr.model import Model, Stretch
from lava_vpr.training.stretches import traverses_shown

SETTINGS, RATES = "learning/learning.json", "learning/rates.npy"
PURPOSE = "learning on the chip"
ARRAYS = ("weights", "thresholds", "epochs", "images", "keys")


@dataclass(frozen=True)
class ChipLearning:
    """The learning network of one stretch, and all its presentations.

    Attributes:
        phases: See `FoldedPhase`.
        start: Weights and thresholds; not changed.
        seeds: Lava's ``rng_seed`` of each epoch.
        epochs, images, keys: The epoch, the row of ``rates`` and the key of each presentation, in order.
        rates: Rates of the inputs for all reference images, uint16 (images, inputs), units of 2^-16.
        places: Places of the stretch: every epoch shows all of them, traverse after traverse, in one order.
        again: How often places that no neuron has made its own are shown again after the last epoch
            (`engine.learning.recruiting`).
    """

    phases: tuple[FoldedPhase, ...]
    start: PlasticState
    seeds: tuple[int, ...]
    epochs: NDArray[np.int32]
    images: NDArray[np.int32]
    keys: NDArray[np.uint64]
    rates: NDArray[np.uint16]
    places: int
    again: int

    def trainer(self) -> FoldedTrainer:
        """A new trainer at the start."""
        state = PlasticState(self.start.weights.copy(), self.start.theta.copy())
        return FoldedTrainer(self.phases, state, self.seeds)

    def train(self) -> NDArray[np.uint8]:
        """The weights after all presentations on the host, uint8 (inputs, neurons)."""
        trainer, epoch, shown = self.trainer(), -1, list[tuple[int, int]]()
        counts = np.zeros((self.places, len(self.start.theta)), np.int64)
        for number, image, key in zip(self.epochs.tolist(), self.images.tolist(), self.keys.tolist(), strict=True):
            if number != epoch:
                epoch, shown, counts[:] = number, [], 0
                trainer.begin_epoch(epoch)
            counts[len(shown) % self.places] += trainer.present(self.rates[image], key)
            shown.append((image, key))

        def again(place: int, times: int) -> NDArray[np.int64]:
            images = shown[place :: self.places]
            return np.sum([trainer.present(self.rates[image], key_again(key, times)) for image, key in images], axis=0)

        recruit(trainer.thresholds(), counts, self.again, again)
        weights: NDArray[np.uint8] = trainer.state()["weights"].astype(np.uint8)
        return weights


def _stretch_learning(model: Model, stretch: Stretch, rates: NDArray[np.uint16]) -> ChipLearning:
    """The learning network of one stretch of ``model``, as training shows it the references, with these ``rates``.

    Raises:
        ConfigError: the model learns by no rule, or all neurons of the stretch went with removed places.
    """
    config = integer_config(model.config, PURPOSE)
    learning = config.learning
    if not stretch.neurons:
        places = f"{stretch.first_place}:{stretch.first_place + stretch.places}"
        raise ConfigError(f"{PURPOSE} needs neurons, but those of places {places} were removed; train again")
    if learning.rule != "stdp":
        raise ConfigError(f"{PURPOSE} takes rule stdp alone, not {learning.rule}; train with --learning integer")
    inputs, spikes = config.encoder.inputs, config.encoder.learning_spikes
    views, references = len(config.views.views), len(model.labels) // model.places
    shown = [
        (epoch, shown_as, stretch.first_place + place)
        for epoch in range(learning.epochs)
        for shown_as in range(stretch.view, traverses_shown(config, epoch, references // views) * views, views)
        for place in range(stretch.places)
    ]
    images = image_keys(rates).reshape(references, model.places)
    keys = [
        presentation_key(config.seed, "train", int(images[shown_as, place]), epoch * references + shown_as)
        for epoch, shown_as, place in shown
    ]
    first = stretch.first_place
    start = stretch_key(images[stretch.view, first : first + stretch.places])  # as training draws its start weights
    return ChipLearning(
        phases=folded_phases(learning, inputs, spikes),
        start=initial_state(inputs, stretch.neurons, learning, spikes, config.seed, start),
        seeds=tuple(library_seed(config.seed, start, epoch) for epoch in range(learning.epochs)),
        epochs=np.array([epoch for epoch, _, _ in shown], np.int32),
        images=np.array([shown_as * model.places + place for _, shown_as, place in shown], np.int32),
        keys=np.array(keys, np.uint64),
        rates=rates,
        places=stretch.places,
        again=rounds(learning),
    )


def chip_learning(model: Model, rates: NDArray[np.uint16] | None = None) -> tuple[ChipLearning, ...]:
    """The learning networks of all stretches of ``model``.

    Args:
        model: The model, with its references.
        rates: Rates of all reference images, uint16 (images, inputs); None: those of its activity.
    Raises:
        ConfigError: the model learns by no rule, or with a setting, that the chip cannot express.
        NetworkLimitError: a network could overflow.
    """
    own = _rates(model) if rates is None else rates
    return tuple(_stretch_learning(model, stretch, own) for stretch in model.stretches)


def _rates(model: Model) -> NDArray[np.uint16]:
    """Rates at which the references of ``model`` are learned, uint16 (images, inputs)."""
    return rates16(model.activity, integer_config(model.config, PURPOSE).encoder.learning_spikes)


def _phase_json(phase: FoldedPhase) -> dict[str, Any]:
    """A phase with Lava's names where Lava has them."""
    chip, rule = phase.chip, phase.chip.rule
    mantissa, exponent = mantissa_of(chip.inhibition, WEIGHT_LIMIT)
    return {
        "learning_rule": {
            "dw": rule.microcode(),
            "x1_impulse": TRACE_LIMIT,
            "x1_tau": rule.tau,
            "t_epoch": 1,
            "products": [list(product) for product in rule.products],
            "target": rule.target,
            "mu": rule.mu,
        },
        "plastic": {"weight_exp": 0, "sign_mode": "EXCITATORY"},
        "exc": {"du": chip.neurons.du, "dv": chip.neurons.dv},
        "inhibit": {"mantissa": mantissa, "weight_exp": exponent},
        "trains": "regular" if chip.regular else "poisson",
        "steps": chip.steps,
        "silent_steps": chip.silent_steps,
        "epochs": phase.epochs,
        "host": {
            "weight_sum": phase.weight_sum,
            "theta_plus": phase.theta_plus,
            "threshold_factor": phase.threshold_factor,
            "threshold_factor_bits": FACTOR_BITS,
        },
    }


def _folder(number: int) -> str:
    """Folder of the arrays of a stretch."""
    return f"learning/stretch{number:03d}"


def learning_files(model: Model, rates: NDArray[np.uint16] | None = None) -> dict[str, bytes]:
    """The files of the learning networks of ``model``, by name in the bundle; see `chip_learning`."""
    parts = chip_learning(model, rates)
    stretches, files = [], {RATES: array_bytes(parts[0].rates)}
    for number, (part, stretch) in enumerate(zip(parts, model.stretches, strict=True)):
        folder = _folder(number)
        values: tuple[NDArray[Any], ...] = (part.start.weights, part.start.theta, part.epochs, part.images, part.keys)
        files |= {f"{folder}/{name}.npy": array_bytes(value) for name, value in zip(ARRAYS, values, strict=True)}
        told = {"rng_seeds": list(part.seeds), "again": part.again}
        phases = [_phase_json(phase) for phase in part.phases]
        stretches.append({**asdict(stretch), "folder": folder, **told, "phases": phases})
    files[SETTINGS] = json_bytes({"seed": model.config.seed, "stretches": stretches})
    return files


def check_learning(bundle: ReadBundle, model: Model) -> None:
    """Refuse learning networks that are not what this version writes for the stretches and images of ``model``.

    Raises:
        BundleError: naming a file that differs, or why the chip cannot learn this model.
    """
    config, traverses = model.config, len(model.labels) // model.places // len(model.config.views.views)
    rates = rates_of(bundle, RATES, _rates(model))
    for number, stretch in enumerate(model.stretches):  # a schedule is no longer than its file
        shown = sum(traverses_shown(config, epoch, traverses) for epoch in range(config.learning.epochs))
        bundle.array(f"{_folder(number)}/keys.npy", np.uint64, (shown * stretch.places,))
    try:
        files = learning_files(model, rates)
    except LavaVprError as error:
        raise BundleError(f"{bundle.at(SETTINGS)}: cannot be used ({error}); {AGAIN}") from None
    bundle.demand(files)


def learned_on_chip(model: Model, threads: int) -> Model:
    """``model`` with what its learning networks learn, quantised as it is, its responses measured again.

    The chip learns unsigned weights; where ``network.signed`` is set, quantising takes off what all neurons share.

    Args:
        model: With float weights of its own.
        threads: For the responses; does not change the result.
    """
    trained = [part.train().astype(np.float32) for part in chip_learning(model)]
    for weights in trained:
        stdp.normalise(weights, integer_config(model.config, PURPOSE).learning.mean_weight)
    return requantised(replace(model, learned=np.concatenate(trained, axis=1)), threads=threads)
