"""What a Loihi 2 bundle holds of the network that learns: enough to train it anew, on the host, in Lava or on a board.

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
from lava_vpr.deploy.boards.clearing import check_reset
from lava_vpr.deploy.bundle.core_files import within
from lava_vpr.deploy.bundle.folder import AGAIN, ReadBundle, array_bytes, json_bytes, same_json
from lava_vpr.deploy.compression.compression import requantised
from lava_vpr.encoding import rates16
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.inference.quantise import mantissa_of
from lava_vpr.engine.learning import stdp
from lava_vpr.engine.learning.integer import IntegerLearning, IntegerState, WeightRule
from lava_vpr.engine.learning.integer_kernels import SILENT_STEPS
from lava_vpr.engine.learning.lava_order import (
    FACTOR_BITS,
    FoldedPhase,
    FoldedTrainer,
    folded_phases,
    library_seed,
    start_state,
)
from lava_vpr.engine.learning.recruiting import key_again, recruit, rounds
from lava_vpr.engine.random import image_keys, presentation_key, stretch_key
from lava_vpr.errors import BundleError, ConfigError, NetworkLimitError, brief
from lava_vpr.loihi import INPUT_LIMIT, LOIHI_2_RESET_LIMIT, THRESHOLD_LIMIT, TRACE_LIMIT, WEIGHT_LIMIT
from lava_vpr.model import Model, Stretch
from lava_vpr.settings.ranges import real, whole
from lava_vpr.storage.limits import excess
from lava_vpr.storage.text import shown
from lava_vpr.training.stretches import traverses_shown

SETTINGS, RATES = "learning/learning.json", "learning/rates.npy"
PURPOSE = "learning on the chip"
ARRAYS = ("weights", "thresholds", "epochs", "images", "keys")
_MOST_STEPS, _MOST_EPOCHS, _LONGEST_TAU, _MOST_FACTOR = 100_000, 10_000, 10_000, 10
"""The ranges of the settings (`lava_vpr.config`) that these come from."""
_MOST_PHASES, _MOST_PRODUCTS = 16, 64


@dataclass(frozen=True)
class ChipLearning:
    """One stretch's network that learns, and all that is shown to it.

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
    start: IntegerState
    seeds: tuple[int, ...]
    epochs: NDArray[np.int32]
    images: NDArray[np.int32]
    keys: NDArray[np.uint64]
    rates: NDArray[np.uint16]
    places: int
    again: int

    @property
    def presentations(self) -> int:
        """The most presentations that training takes: those of the schedule, and the last epoch's again."""
        return len(self.epochs) + self.again * int(np.count_nonzero(self.epochs == self.epochs.max(initial=0)))

    def trainer(self) -> FoldedTrainer:
        """A new trainer at the start."""
        state = IntegerState(self.start.weights.copy(), self.start.theta.copy())
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

    def job(self, presentations: int) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """The first presentations of the first epoch, for `lava_vpr.processes.jobs.learning.folded`."""
        images = self.images[:presentations]
        arrays = {"weights": self.start.weights, "theta": self.start.theta, "rates": self.rates[images]}
        options = {"phases": [asdict(phase) for phase in self.phases], "seeds": list(self.seeds), "epoch": 0}
        return arrays | {"keys": self.keys[:presentations]}, options


def stretch_learning(model: Model, stretch: Stretch) -> ChipLearning:
    """The learning network of one stretch of ``model``, as training shows it the references.

    Raises:
        ConfigError: the model learns by no rule, or all neurons of the stretch went with removed places.
    """
    config = integer_config(model.config, PURPOSE)
    learning = config.learning
    if not stretch.neurons:
        places = f"{stretch.first_place}:{stretch.first_place + stretch.places}"
        raise ConfigError(f"{PURPOSE} needs neurons, but those of places {places} went with removed ones; train anew")
    if learning.rule != "stdp":
        raise ConfigError(f"{PURPOSE} needs weights that were learned, not templates; train with --learning integer")
    inputs, spikes = config.encoder.inputs, config.encoder.train_spikes
    views, references = len(config.views.views), len(model.labels) // model.places
    shown = [
        (epoch, shown_as, stretch.first_place + place)
        for epoch in range(learning.epochs)
        for shown_as in range(stretch.view, traverses_shown(config, epoch, references // views) * views, views)
        for place in range(stretch.places)
    ]
    rates = rates16(model.activity, spikes)
    images = image_keys(rates).reshape(references, model.places)
    keys = [
        presentation_key(config.seed, "train", int(images[shown_as, place]), epoch * references + shown_as)
        for epoch, shown_as, place in shown
    ]
    first = stretch.first_place
    start = stretch_key(images[stretch.view, first : first + stretch.places])  # as training draws its start weights
    return ChipLearning(
        phases=folded_phases(learning, inputs, spikes),
        start=start_state(learning, inputs, stretch.neurons, spikes, config.seed, start),
        seeds=tuple(library_seed(config.seed, start, epoch) for epoch in range(learning.epochs)),
        epochs=np.array([epoch for epoch, _, _ in shown], np.int32),
        images=np.array([shown_as * model.places + place for _, shown_as, place in shown], np.int32),
        keys=np.array(keys, np.uint64),
        rates=rates,
        places=stretch.places,
        again=rounds(learning),
    )


def chip_learning(model: Model) -> tuple[ChipLearning, ...]:
    """The learning networks of all stretches of ``model``."""
    return tuple(stretch_learning(model, stretch) for stretch in model.stretches)


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


def _phase(described: Any, inputs: int) -> FoldedPhase:
    """The phase that `_phase_json` wrote, for a network of so many inputs.

    Raises:
        KeyError, TypeError, ValueError: it wrote none such.
        NetworkLimitError: the chip cannot hold it.
    """
    rule, host, inhibit = (described[name] for name in ("learning_rule", "host", "inhibit"))
    pairs = rule["products"]
    if not isinstance(pairs, list) or len(pairs) > _MOST_PRODUCTS:
        raise ValueError(f"products {brief(pairs)}")
    tau = rule["x1_tau"]
    if not real(tau) or not 1 <= tau <= _LONGEST_TAU:
        raise ValueError(f"x1_tau {brief(tau)}")
    exponent = _whole(inhibit, "weight_exp", INPUT_LIMIT.bit_length())
    inhibition = _whole(inhibit, "mantissa", WEIGHT_LIMIT) << exponent
    phase = FoldedPhase(
        IntegerLearning(
            rule=WeightRule(
                tuple(_product(pair) for pair in pairs), _whole(rule, "target"), _whole(rule, "mu"), float(tau)
            ),
            inhibition=inhibition,
            neurons=LifParameters(du=_whole(described["exc"], "du"), dv=_whole(described["exc"], "dv")),
            weight_sum=0,
            steps=_whole(described, "steps", _MOST_STEPS, 1),
            regular=described["trains"] == "regular",
            silent_steps=_whole(described, "silent_steps", LOIHI_2_RESET_LIMIT, SILENT_STEPS),
        ),
        weight_sum=_whole(host, "weight_sum", WEIGHT_LIMIT * inputs),
        theta_plus=_whole(host, "theta_plus"),
        threshold_factor=_whole(host, "threshold_factor", _MOST_FACTOR << FACTOR_BITS),
        epochs=_whole(described, "epochs", _MOST_EPOCHS),
    )
    phase.chip.check()
    check_reset(phase.chip.interval, "learning.steps")
    if inhibition >= INPUT_LIMIT:
        raise ValueError(f"inhibition {inhibition}")
    if phase.chip.rule.microcode() != rule["dw"]:
        raise ValueError(f"dw {brief(rule['dw'])} that is not the sum of its products")
    again = _phase_json(phase)
    for name in sorted({*again, *described}):
        if name not in again or not same_json(again[name], described.get(name)):
            raise ValueError(f"{brief(name)} {brief(described.get(name))} of a phase")
    return phase


def _product(pair: Any) -> tuple[int, int]:
    """A mantissa and an exponent."""
    if not isinstance(pair, list) or len(pair) != 2:
        raise ValueError(f"product {brief(pair)}")
    return _whole(pair, 0, 7, -8), _whole(pair, 1, 8, -7)


def _whole(values: Any, name: str | int, most: int = (1 << 31) - 1, least: int = 0) -> int:
    """The whole number called ``name`` in ``values``.

    Raises:
        KeyError, TypeError, ValueError: it lacks, or is outside ``least`` .. ``most``.
    """
    value = values[name]
    if not whole(value) or not least <= value <= most:
        raise ValueError(f"{name} {brief(value)}, of {least}..{most}")
    return int(value)


def _folder(number: int) -> str:
    """Where the arrays of a stretch stand."""
    return f"learning/stretch{number:03d}"


def learning_files(model: Model) -> dict[str, bytes]:
    """The files of the learning networks of ``model``, by name in the bundle.

    Raises:
        ConfigError: the model learns by a rule, or with a setting, that the chip cannot express.
        NetworkLimitError: a network could overflow.
    """
    parts = chip_learning(model)
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


def read_learning(bundle: ReadBundle) -> tuple[ChipLearning, ...]:
    """The learning networks in a bundle, from its files alone.

    Raises:
        BundleError: it holds none, parts do not fit each other, or training costs more than the limits allow.
    """
    if SETTINGS not in bundle.files:
        raise BundleError(f"{shown(bundle.path)}: holds no network that learns; deploy the model with --learning")
    rates, told = bundle.array(RATES, np.uint16, ("images", "inputs")), bundle.json(SETTINGS)
    try:
        stretches = told["stretches"]
        if not isinstance(stretches, list) or not stretches:
            raise ValueError(f"stretches {brief(stretches)}")
        parts = tuple(_part(bundle, number, described, rates) for number, described in enumerate(stretches))
    except (KeyError, TypeError, ValueError, IndexError, NetworkLimitError) as error:
        raise BundleError(f"{bundle.at(SETTINGS)}: lacks or garbles {error}; {AGAIN}") from None
    operations = sum(
        part.presentations * (max(phase.chip.interval for phase in part.phases)) * part.start.weights.size
        for part in parts
    )
    beyond = excess("training_operations", operations)
    if beyond is not None:
        raise BundleError(f"{bundle.at(SETTINGS)}: asks for training of {beyond}")
    return parts


def _part(bundle: ReadBundle, number: int, described: Any, rates: NDArray[np.uint16]) -> ChipLearning:
    """The learning network of one stretch.

    Raises:
        BundleError: an array is missing, of the wrong kind or out of range.
        KeyError, TypeError, ValueError: its description lacks something.
        NetworkLimitError: the chip cannot hold it.
    """
    folder = _folder(number)
    if described["folder"] != folder:
        raise ValueError(f"folder {brief(described['folder'])} instead of {folder}")
    files = {name: f"{folder}/{name}.npy" for name in ARRAYS}
    weights = bundle.array(files["weights"], np.uint8, (rates.shape[1], "neurons"))
    neurons = weights.shape[1]
    if neurons == 0:
        raise ValueError(f"stretch {number} without a neuron")
    thresholds = bundle.array(files["thresholds"], np.int32, (neurons,))
    within(bundle, files["thresholds"], "threshold", thresholds, THRESHOLD_LIMIT, 1)
    seeds, phases = described["rng_seeds"], described["phases"]
    for name, values, most in (("rng_seeds", seeds, _MOST_EPOCHS), ("phases", phases, _MOST_PHASES)):
        if not isinstance(values, list) or not 0 < len(values) <= most:
            raise ValueError(f"{name} {brief(values)}")
    read = tuple(_phase(phase, rates.shape[1]) for phase in phases)
    if sum(phase.epochs for phase in read) != len(seeds):
        raise ValueError(f"phases of {sum(phase.epochs for phase in read)} epochs with {len(seeds)} seeds")
    epochs = bundle.array(files["epochs"], np.int32, ("presentations",))
    within(bundle, files["epochs"], "epoch", epochs, len(seeds))
    if (np.diff(epochs) < 0).any():
        raise ValueError(f"epochs of stretch {number}, which go back")
    places, last = _whole(described, "places", least=1), int(np.count_nonzero(epochs == epochs.max(initial=0)))
    if not last or last % places:
        raise ValueError(f"a last epoch of stretch {number} that does not show {places} places equally often")
    images = bundle.array(files["images"], np.int32, epochs.shape)
    within(bundle, files["images"], "image", images, len(rates))
    return ChipLearning(
        read,
        IntegerState(weights, thresholds),
        tuple(_whole(seeds, number) for number in range(len(seeds))),
        epochs,
        images,
        bundle.array(files["keys"], np.uint64, epochs.shape),
        rates,
        places,
        _whole(described, "again", _MOST_EPOCHS),
    )


def check_learning(bundle: ReadBundle, model: Model) -> None:
    """Refuse learning networks that cannot be read, or are not those of the stretches and images of ``model``.

    Raises:
        BundleError: naming what does not fit.
    """
    parts, described = read_learning(bundle), bundle.json(SETTINGS)["stretches"]
    if parts[0].rates.shape != model.activity.shape:
        raise BundleError(f"{bundle.at(RATES)}: is {parts[0].rates.shape} for {model.activity.shape} images; {AGAIN}")
    own = [
        {name: told.get(name) for name in asdict(stretch)}
        for told, stretch in zip(described, model.stretches, strict=False)
    ]
    sizes = [part.start.weights.shape[1] for part in parts]
    same = same_json(own, [asdict(stretch) for stretch in model.stretches]) and len(parts) == len(model.stretches)
    if not same or sizes != [stretch.neurons for stretch in model.stretches]:
        raise BundleError(f"{bundle.at(SETTINGS)}: has other stretches than the model; {AGAIN}")


def learned_weights(parts: tuple[ChipLearning, ...], mean_weight: float) -> NDArray[np.float32]:
    """Float weights (inputs, neurons) of all stretches after learning, each neuron's mean ``mean_weight``."""
    trained = [part.train().astype(np.float32) for part in parts]
    for weights in trained:
        stdp.normalise(weights, mean_weight)
    return np.concatenate(trained, axis=1)


def learned_on_chip(model: Model, parts: tuple[ChipLearning, ...], threads: int) -> Model:
    """``model`` with what its learning networks learn, quantised as it is, its responses measured again.

    The chip learns unsigned weights; where ``network.signed`` is set, quantising takes off what all neurons share.

    Args:
        model: With float weights of its own.
        parts: The learning networks of its stretches.
        threads: For the responses; does not change the result.
    """
    weights = learned_weights(parts, integer_config(model.config, PURPOSE).learning.mean_weight)
    return requantised(replace(model, learned=weights), threads=threads)
