"""What a Loihi 2 bundle holds of the network that learns: enough to train it anew, on the host, in Lava or on a board.

Lava's library has one threshold for all neurons, no floor, no hold and no normalisation; `engine.learning.lava_order`
is learning without these. ``learning/learning.json`` has the rule (as LearningDense takes it), the neurons, what the
host does between presentations, and the schedule; ``learning/rates.npy`` the reference images as they are shown. Each
stretch of the route has a network of its own, in ``learning/stretchNNN/``: start weights and thresholds, and for every
presentation in order its epoch, image and key.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.bundle.folder import AGAIN, Bundle, array_bytes, json_bytes
from lava_vpr.deploy.compression.compression import requantised
from lava_vpr.encoding import rates16
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.inference.fixed import SILENT_STEPS
from lava_vpr.engine.inference.quantise import mantissa_of
from lava_vpr.engine.learning import stdp
from lava_vpr.engine.learning.integer import IntegerLearning, IntegerState, Rule
from lava_vpr.engine.learning.lava_order import (
    FACTOR_BITS,
    FoldedPhase,
    FoldedTrainer,
    folded_phases,
    library_seed,
    start_state,
)
from lava_vpr.engine.random import presentation_key
from lava_vpr.errors import BundleError
from lava_vpr.gate import integer_config
from lava_vpr.loihi import TRACE_LIMIT
from lava_vpr.model import Model, Stretch
from lava_vpr.training.loop import traverses_shown

SETTINGS, RATES = "learning/learning.json", "learning/rates.npy"
PURPOSE = "learning on the chip"
ARRAYS = ("weights", "thresholds", "epochs", "images", "keys")


@dataclass(frozen=True)
class ChipLearning:
    """One stretch's network that learns, and all that is shown to it.

    Attributes:
        phases: See `FoldedPhase`.
        start: Weights and thresholds; not changed.
        seeds: Lava's ``rng_seed`` of each epoch.
        epochs, images, keys: The epoch, the row of ``rates`` and the key of each presentation, in order.
        rates: Rates of the inputs for all reference images, uint16 (images, inputs), units of 2^-16.
    """

    phases: tuple[FoldedPhase, ...]
    start: IntegerState
    seeds: tuple[int, ...]
    epochs: NDArray[np.int32]
    images: NDArray[np.int32]
    keys: NDArray[np.uint64]
    rates: NDArray[np.uint16]

    def trainer(self) -> FoldedTrainer:
        """A new trainer at the start."""
        state = IntegerState(self.start.weights.copy(), self.start.theta.copy())
        return FoldedTrainer(self.phases, state, self.seeds)

    def train(self) -> NDArray[np.uint8]:
        """The weights after all presentations on the host, uint8 (inputs, neurons)."""
        trainer, epoch = self.trainer(), -1
        for number, image, key in zip(self.epochs.tolist(), self.images.tolist(), self.keys.tolist(), strict=True):
            if number != epoch:
                epoch = number
                trainer.begin_epoch(epoch)
            trainer.present(self.rates[image], key)
        weights: NDArray[np.uint8] = trainer.state()["weights"].astype(np.uint8)
        return weights

    def job(self, presentations: int) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """The first presentations of the first epoch, for `lava_vpr.processes.jobs.learning.folded`."""
        images = self.images[:presentations]
        arrays = {"weights": self.start.weights, "theta": self.start.theta, "rates": self.rates[images]}
        options = {"phases": [asdict(phase) for phase in self.phases], "seeds": list(self.seeds), "epoch": 0}
        return arrays | {"keys": self.keys[:presentations]}, options


def stretch_learning(model: Model, stretch: Stretch, number: int) -> ChipLearning:
    """The learning network of one stretch of ``model``, as training shows it the references."""
    config = integer_config(model.config, PURPOSE)
    learning = config.learning
    size = (config.encoder.inputs, stretch.neurons)
    drive = (config.encoder.train_spikes, config.network.drive)
    traverses = len(model.labels) // model.places
    shown = [
        (epoch, traverse, stretch.first_place + place)
        for epoch in range(learning.epochs)
        for traverse in range(traverses_shown(config, epoch, traverses))
        for place in range(stretch.places)
    ]
    keys = [
        presentation_key(config.seed, "train", int(model.place_indices[place]), epoch * traverses + traverse)
        for epoch, traverse, place in shown
    ]
    return ChipLearning(
        phases=folded_phases(learning, *size, *drive),
        start=start_state(learning, *size, *drive, config.seed, number),
        seeds=tuple(library_seed(config.seed, number, epoch) for epoch in range(learning.epochs)),
        epochs=np.array([epoch for epoch, _, _ in shown], np.int32),
        images=np.array([traverse * model.places + place for _, traverse, place in shown], np.int32),
        keys=np.array(keys, np.uint64),
        rates=rates16(model.activity, config.encoder.train_spikes),
    )


def chip_learning(model: Model) -> tuple[ChipLearning, ...]:
    """The learning networks of all stretches of ``model``."""
    return tuple(stretch_learning(model, stretch, number) for number, stretch in enumerate(model.stretches))


def _phase_json(phase: FoldedPhase) -> dict[str, Any]:
    """A phase with Lava's names where Lava has them."""
    chip, rule = phase.chip, phase.chip.rule
    mantissa, exponent = mantissa_of(chip.inhibition)
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
        "plastic": {"weight_exp": -chip.shift, "sign_mode": "EXCITATORY"},
        "exc": {"du": chip.neurons.du, "dv": chip.neurons.dv},
        "inhibit": {"mantissa": mantissa, "weight_exp": exponent},
        "steps": chip.steps,
        "silent_steps": SILENT_STEPS,
        "epochs": phase.epochs,
        "host": {
            "weight_sum": phase.weight_sum,
            "theta_plus": phase.theta_plus,
            "threshold_factor": phase.threshold_factor,
            "threshold_factor_bits": FACTOR_BITS,
        },
    }


def _phase(described: Mapping[str, Any]) -> FoldedPhase:
    """The phase that `_phase_json` wrote."""
    rule, host = described["learning_rule"], described["host"]
    products = tuple((int(mantissa), int(exponent)) for mantissa, exponent in rule["products"])
    chip = IntegerLearning(
        rule=Rule(products, int(rule["target"]), int(rule["mu"]), float(rule["x1_tau"])),
        shift=-int(described["plastic"]["weight_exp"]),
        inhibition=int(described["inhibit"]["mantissa"]) << int(described["inhibit"]["weight_exp"]),
        neurons=LifParameters(du=int(described["exc"]["du"]), dv=int(described["exc"]["dv"])),
        weight_sum=0,
        steps=int(described["steps"]),
    )
    return FoldedPhase(
        chip, int(host["weight_sum"]), int(host["theta_plus"]), int(host["threshold_factor"]), int(described["epochs"])
    )


def learning_files(model: Model) -> dict[str, bytes]:
    """The files of the learning networks of ``model``, by name in the bundle.

    Raises:
        ConfigError: the model learns by a rule, or with a setting, that the chip cannot express.
        NetworkLimitError: a network could overflow.
    """
    parts = chip_learning(model)
    stretches, files = [], {RATES: array_bytes(parts[0].rates)}
    for number, (part, stretch) in enumerate(zip(parts, model.stretches, strict=True)):
        folder = f"learning/stretch{number:03d}"
        values: tuple[NDArray[Any], ...] = (part.start.weights, part.start.theta, part.epochs, part.images, part.keys)
        files |= {f"{folder}/{name}.npy": array_bytes(value) for name, value in zip(ARRAYS, values, strict=True)}
        phases = [_phase_json(phase) for phase in part.phases]
        stretches.append({**asdict(stretch), "folder": folder, "rng_seeds": list(part.seeds), "phases": phases})
    files[SETTINGS] = json_bytes({"seed": model.config.seed, "stretches": stretches})
    return files


def read_learning(bundle: Bundle) -> tuple[ChipLearning, ...]:
    """The learning networks in a bundle, from its files alone.

    Raises:
        BundleError: it holds none, or parts do not fit each other.
    """
    if SETTINGS not in bundle.files:
        raise BundleError(f"{bundle.path}: holds no network that learns; deploy the model with --learning")
    rates, parts = bundle.array(RATES), []
    try:
        for described in bundle.json(SETTINGS)["stretches"]:
            values = {name: bundle.array(f"{described['folder']}/{name}.npy") for name in ARRAYS}
            phases = tuple(_phase(phase) for phase in described["phases"])
            for phase, stored in zip(phases, described["phases"], strict=True):
                if phase.chip.rule.microcode() != stored["learning_rule"]["dw"]:
                    raise ValueError(f"dw {stored['learning_rule']['dw']!r} that is not the sum of its products")
                phase.chip.check(values["weights"].shape[1])
            parts.append(
                ChipLearning(
                    phases,
                    IntegerState(values["weights"], values["thresholds"]),
                    tuple(int(seed) for seed in described["rng_seeds"]),
                    values["epochs"],
                    values["images"],
                    values["keys"],
                    rates,
                )
            )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise BundleError(f"{bundle.path / SETTINGS}: lacks or garbles {error}; {AGAIN}") from None
    return tuple(parts)


def learned_weights(parts: tuple[ChipLearning, ...], mean_weight: float) -> NDArray[np.float32]:
    """Float weights (inputs, neurons) of all stretches after learning, each neuron's mean ``mean_weight``."""
    trained = [part.train().astype(np.float32) for part in parts]
    for weights in trained:
        stdp.normalise(weights, mean_weight)
    return np.concatenate(trained, axis=1)


def learned_on_chip(model: Model, parts: tuple[ChipLearning, ...], threads: int) -> Model:
    """``model`` with what its learning networks learn, quantised as it is, its responses measured again.

    Args:
        model: With float weights of its own.
        parts: The learning networks of its stretches.
        threads: For the responses; does not change the result.
    """
    weights = learned_weights(parts, integer_config(model.config, PURPOSE).learning.mean_weight)
    return requantised(replace(model, learned=weights), threads=threads)
