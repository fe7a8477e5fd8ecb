"""Frozen, self-checking settings of encoder, network, learning and decoder; the presets.

One `Config` plus the learned weights says everything about a network; every backend runs that and has no parameters
of its own. Units stand in the names. Source: ``docs/network.md``. The network and learning of preset ``paper`` are in
`lava_vpr.settings.conductance`.
"""

from __future__ import annotations

import typing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal, cast

from lava_vpr.errors import ConfigError, brief
from lava_vpr.inputs.encoder import INPUTS, EncoderConfig
from lava_vpr.inputs.views import AugmentConfig, ViewsConfig
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.neurons.models import CONDUCTANCE, LIF, NEURONS, stepped
from lava_vpr.rows.registry import elsewhere, plugged_names
from lava_vpr.settings.conductance import ConductanceLearning, ConductanceNetwork
from lava_vpr.settings.ranges import Range, check, need

InputMode = Literal["injected", "bias"]
INPUT_MODES: tuple[str, ...] = typing.get_args(InputMode)
SpikeTrains = Literal["poisson", "regular"]
UNSIGNED = ("stdp", "template")
"""The learning rules of this program whose weights are at least 0."""
LIF_RULES = (*UNSIGNED, "slayer")
"""The learning rules of this program with the lif network."""
RULES_GROUP = "lava_vpr.learning_rules"
"""The entry points of other packages' learning rules."""
_SIGNED_BITS = Range(1, 7)
"""Bits of a weight's magnitude beside its sign."""


@dataclass(frozen=True)
class LifNetwork:
    """The integer network: current-based LIF, which Loihi runs, or a plug-in's; one threshold, one inhibitory neuron.

    Threshold and inhibition are in units of the drive per step that a neuron's own place brings it, whatever the number
    of input spikes, bits or neurons; `lava_vpr.engine.inference.quantise` turns them into the chip's integers.

    Attributes:
        model: The neuron model of queries and reference responses: ``lif``, or a plug-in's
            (`lava_vpr.neurons.models.NeuronModel`).
        neurons: Excitatory neurons of one stretch; 0 means `neurons_per_place` for each place.
        neurons_per_place: Used when ``neurons`` is 0.
        steps: Steps of 1 ms of one presentation, the silent ones at its end included
            (`lava_vpr.engine.inference.fixed.silent_steps`): a power of two, the only intervals at which a Loihi 2 chip
            resets its states.
        signed: Weights are what a neuron has learned less what all neurons share, with a sign, and its mean drive over
            the references is taken off as a bias.
        surroundings: Of how many places on either side of a neuron's own, of its stretch, the mean is taken off its
            weights (`lava_vpr.engine.inference.surroundings`); 0: the mean over all. Signed weights only.
        weight_bits: Bits of one weight's magnitude: 1..8, signed 1..7.
        prune: Share of each neuron's weights, those of the smallest magnitude, that is set to 0.
        threshold: Firing threshold of every excitatory neuron.
        inhibition: How much the inhibitory neuron inhibits every excitatory one after any of them has spiked.
        tau_membrane: Membrane time constant, in steps.
        trains: How inputs spike in queries: ``regular`` trains of random phases (`engine.inference.bias_input`), or
            ``poisson``. Learning has a setting of its own (`StdpLearning.trains`).
        input_mode: Where regular trains are made: by the host, which ``injected`` spikes into the chip, or by input
            compartments that integrate a ``bias`` written once a query. Learning always injects.
        adapt: Time constant in queries by which biases follow the queries before, of who tracks a robot
            (`lava_vpr.backends.asking.Asking.tracking`); 0: they do not. Unsigned weights have no biases.
    """

    model: str = LIF.name
    neurons: Annotated[int, Range(0, 100_000)] = 0
    neurons_per_place: Annotated[float, Range(0, 100, "least")] = 1.0
    steps: Annotated[int, Range(4, 65_536, only="a power of two")] = 128
    signed: bool = True
    surroundings: Annotated[int, Range(0, 1000)] = 0
    weight_bits: Annotated[int, Range(1, 8)] = 3
    prune: Annotated[float, Range(0, 1, "most")] = 0.0
    threshold: Annotated[float, Range(0, 10_000, "least")] = 1.0
    inhibition: Annotated[float, Range(0, 10_000)] = 0.67
    tau_membrane: Annotated[float, Range(1, 4096, "least")] = 12.0
    trains: SpikeTrains = "regular"
    input_mode: InputMode = "injected"
    adapt: Annotated[int, Range(0, 1_000_000)] = 30

    def __post_init__(self) -> None:
        check(self, "network", **({"weight_bits": _SIGNED_BITS} if self.signed else {}))
        if not stepped(self.model):
            known = ", ".join(name for name in NEURONS.names() if name != CONDUCTANCE.name)
            need(False, "network.model", self.model, f"{known}{NEURONS.elsewhere}")
        fits = self.trains == "regular" or self.input_mode == "injected"
        need(fits, "network.trains", self.trains, "regular where input_mode is bias")
        need(self.signed or not self.surroundings, "network.surroundings", self.surroundings, "0 where signed is false")


@dataclass(frozen=True)
class StdpLearning:
    """The paper's STDP rule with homeostasis and normalisation (its equation for the weight change, mu = ``mu``).

    On a postsynaptic spike ``w += eta (x_pre - x_target) (w_max - w)^mu``, w in [0, w_max]. Learning has two phases: in
    the first neurons compete for places, with rising thresholds; in the second, thresholds rest and a slower rule
    averages the noise of single presentations out of what each neuron has made its own.

    Attributes:
        rule: ``stdp``; or ``template``, which learns nothing: the rates of a place's references are its neuron's
            weights, the baseline for learning; or ``slayer``, by gradients (`SlayerConfig`), which of the settings
            here takes ``epochs`` alone; or a plug-in's (`lava_vpr.training.trainers.LearningRule`).
        arithmetic: ``float``, or ``integer``: Loihi's own (`engine.learning.integer`). Either result is quantised.
        trains: How inputs spike while learning, as `LifNetwork.trains`. Regular trains show rates without noise, so
            what is learned is nearer to what is shown.
        theta_update: Thresholds rise with each ``spike``, or all after a ``presentation``.
        epochs: Times that every reference image is shown.
        competition_epochs: How many of them belong to the first phase, at most half (`competing`). In that phase only
            the first traverse is shown: it decides who learns what, and every neuron then consolidates all traverses.
        steps: Steps of 1 ms of one training presentation.
        eta, tau_trace, x_target: Learning rate, decay of the presynaptic trace in steps, and the trace below which a
            weight falls, in units of the mean trace of all inputs; first phase.
        consolidation_eta, consolidation_tau_trace, consolidation_x_target: The same in the second phase.
        threshold, theta_plus: Threshold at the start, and what each spike of the first phase adds to it for good.
        consolidation_threshold: Factor on the thresholds when the second phase begins.
        recruit: After the second phase, show places that no neuron has made its own to neurons that have no place, as
            often as it showed all (`engine.learning.recruiting`).
        inhibition: What the inhibitory neuron takes, in the units of the threshold, from all but the neurons whose
            spikes made it fire: while they learn, winners are spared.
        tau_membrane, floor: Membrane time constant in steps; ``floor`` bounds the membrane from below.
        drive: Drive per step, in the units of the threshold, of a neuron whose weights are all at the mean.
        hold_steps: Steps after a spike in which the membrane stays at 0.
        mean_weight: What each neuron's weights are normalised to before every presentation.
        start_weight: Start weights are ``start_weight * (U[0, 1) + 0.01)``.
    """

    rule: str = "stdp"
    arithmetic: Literal["float", "integer"] = "float"
    trains: SpikeTrains = "regular"
    theta_update: Literal["spike", "presentation"] = "spike"
    epochs: Annotated[int, Range(1, 10_000)] = 8
    competition_epochs: Annotated[int, Range(1, 10_000)] = 4
    steps: Annotated[int, Range(1, 100_000)] = 350
    eta: Annotated[float, Range(0, 10)] = 0.1
    tau_trace: Annotated[float, Range(1, 10_000)] = 20.0
    x_target: Annotated[float, Range(0, 100)] = 0.9
    consolidation_eta: Annotated[float, Range(0, 10)] = 0.03
    consolidation_tau_trace: Annotated[float, Range(1, 10_000)] = 10.0
    consolidation_x_target: Annotated[float, Range(0, 100)] = 0.0
    w_max: Annotated[float, Range(0, 1000, "least")] = 2.0
    mu: Annotated[float, Range(0, 8)] = 0.0
    threshold: Annotated[float, Range(0, 10_000, "least")] = 10.0
    theta_plus: Annotated[float, Range(0, 1000)] = 0.3
    consolidation_threshold: Annotated[float, Range(0, 10, "least")] = 0.5
    recruit: bool = True
    inhibition: Annotated[float, Range(0, 10_000)] = 30.0
    tau_membrane: Annotated[float, Range(1, 4096, "least")] = 20.0
    floor: Annotated[float, Range(-1_000_000, 0)] = -60.0
    drive: Annotated[float, Range(0, 100, "least")] = 0.69
    hold_steps: Annotated[int, Range(0, 1000)] = 1
    mean_weight: Annotated[float, Range(0, 1000, "both")] = 0.1
    start_weight: Annotated[float, Range(0, 1000, "least")] = 0.3

    def __post_init__(self) -> None:
        check(self, "learning")
        if self.rule not in LIF_RULES:
            known = f"{', '.join(LIF_RULES[:-1])} or {LIF_RULES[-1]} with the lif network{elsewhere(RULES_GROUP)}"
            need(self.rule in plugged_names(RULES_GROUP), "learning.rule", self.rule, known)
        need(self.mean_weight < self.w_max, "learning.mean_weight", self.mean_weight, "above 0, below w_max")
        need(self.start_weight <= self.w_max, "learning.start_weight", self.start_weight, "in (0, w_max]")

    @property
    def competing(self) -> int:
        """Epochs of the first phase; only STDP has one."""
        return 0 if self.rule != "stdp" else min(self.competition_epochs, max(1, self.epochs // 2))


@dataclass(frozen=True)
class SlayerConfig:
    """How ``learning.rule`` slayer learns (`lava_vpr.slayer.trainer`); what it is shown, `AugmentConfig` says.

    Attributes:
        start: Weights begin as ``template``, or from ``scratch``: random ones.
        rate: Adam's learning rate, of weights of a neuron of which all together have norm 1, times sqrt(inputs).
        batch: References that make one step.
        sharpness: Factor on spike counts before they become probabilities of places.
        surrogate: How far from the threshold, in thresholds, a membrane still learns: the scale on which the
            gradient of a spike falls.
    """

    start: Literal["template", "scratch"] = "template"
    rate: Annotated[float, Range(0, 10, "least")] = 0.02
    batch: Annotated[int, Range(1, 10_000)] = 50
    sharpness: Annotated[float, Range(0, 100, "least")] = 0.5
    surrogate: Annotated[float, Range(0.001, 100)] = 0.3

    def __post_init__(self) -> None:
        check(self, "slayer")


@dataclass(frozen=True)
class DecoderConfig:
    """Which decoder answers queries, and the paper's gamma (share of the places, 2 %)."""

    default: str = "contrast"
    gamma: Annotated[float, Range(0, 1)] = 0.02

    def __post_init__(self) -> None:
        check(self, "decoder")
        if self.default not in DECODERS:
            known = f"one of {', '.join(DECODERS.names())}{DECODERS.elsewhere}"
            need(False, "decoder.default", self.default, known)


@dataclass(frozen=True)
class Config:
    """Everything that decides a model, apart from the images: settings, the length of a stretch, and the seed."""

    preset: str = "loihi"
    seed: Annotated[int, Range(0, 2**63 - 1)] = 0
    stretch: Annotated[int, Range(0, 1_000_000)] = 100
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    views: ViewsConfig = field(default_factory=ViewsConfig)
    events: EventsConfig = field(default_factory=EventsConfig)
    network: LifNetwork | ConductanceNetwork = field(default_factory=LifNetwork)
    learning: StdpLearning | ConductanceLearning = field(default_factory=StdpLearning)
    slayer: SlayerConfig = field(default_factory=SlayerConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    decoder: DecoderConfig = field(default_factory=DecoderConfig)

    def __post_init__(self) -> None:
        check(self)
        object.__setattr__(self, "seed", int(self.seed))  # random numbers are drawn by whole numbers of Python
        if isinstance(self.network, LifNetwork) != isinstance(self.learning, StdpLearning):
            raise ConfigError(
                f"network.model {self.network.model!r} does not go with learning.rule {self.learning.rule!r}; "
                "use lif with stdp, or conductance with triplet or paper"
            )
        if isinstance(self.network, ConductanceNetwork) and len(self.views.views) > 1:
            raise ConfigError("the conductance network learns one view; set views.shifts and views.scales to 1")
        if INPUTS[self.encoder.kind].sees == "vector" and len(self.views.views) > 1:
            raise ConfigError("a vector has one view; set views.shifts and views.scales to 1")
        front_end = self.encoder.front_end
        if front_end is not None and front_end.window and self.events.image != "counts":
            raise ConfigError(f"encoder.kind {self.encoder.kind!r} takes numbers of events; set events.image to counts")
        if self.encoder.direct is not None and not (_hears(self.network) and self.learning.rule != "slayer"):
            raise ConfigError(
                f"encoder.kind {self.encoder.kind!r} takes the network lif with signed weights, its trains regular and "
                "injected, and no learning by slayer; use these, or encoder.kind frontend"
            )
        if isinstance(self.network, ConductanceNetwork) and not INPUTS[self.encoder.kind].grey_levels:
            kinds = " or ".join(repr(name) for name, row in INPUTS.items() if row.grey_levels)
            raise ConfigError(f"the conductance network takes encoder.kind {kinds}, not {self.encoder.kind!r}")

    @property
    def steps(self) -> int:
        """Steps of a presentation: of the front end whose cells the neurons hear directly, else the network's own."""
        before = self.encoder.direct
        return self.network.steps if before is None else before.steps

    def neurons_for(self, places: int) -> int:
        """Excitatory neurons of one stretch of ``places`` places in one view."""
        if isinstance(self.network, LifNetwork) and self.network.neurons == 0:
            return max(1, round(self.network.neurons_per_place * places))
        return self.network.neurons


def _hears(network: LifNetwork | ConductanceNetwork) -> bool:
    """Whether neurons of ``network`` can hear the cells of a front end themselves."""
    if not isinstance(network, LifNetwork) or network.model != LIF.name or not network.signed:
        return False
    return network.trains == "regular" and network.input_mode == "injected"


PRESETS = {
    "loihi": Config(),
    # The default's learning, and queries in half the steps with fewer spikes from fewer inputs.
    "balanced": Config(
        preset="balanced",
        encoder=EncoderConfig(query_spikes=14.0, query_inputs=420),
        network=LifNetwork(steps=64, threshold=0.7),
    ),
    # Finer orientations, and queries in a quarter of the steps, with coarser weights; a spiking front end as short.
    "fast": Config(
        preset="fast",
        encoder=EncoderConfig(
            orientations=12,
            train_spikes=18.0,
            query_spikes=17.0,
            query_inputs=520,
            pixel_levels=16,
            race_steps=8,
            direct_levels=12,
            direct_race=8,
            read_steps=7,
            read_inhibition=0.25,
        ),
        network=LifNetwork(steps=32, weight_bits=2, threshold=0.7, tau_membrane=40.0),
    ),
    # Finer orientations, spikes to match, and the larger half of the weights less what a place shares with its
    # surroundings: for long maps.
    "accurate": Config(
        preset="accurate",
        encoder=EncoderConfig(orientations=12, train_spikes=18.0, query_spikes=25.0, query_inputs=780),
        network=LifNetwork(surroundings=16, prune=0.5),
    ),
    "paper": Config(
        preset="paper",
        stretch=0,
        encoder=EncoderConfig(kind="pixels"),
        network=ConductanceNetwork(),
        learning=ConductanceLearning(),
        decoder=DecoderConfig(default="weighted_probability"),
    ),
}
"""Every preset by name."""


def preset(name: str) -> Config:
    """The settings of the preset called ``name``.

    Raises:
        ConfigError: no preset has that name.
    """
    if name not in PRESETS:
        raise ConfigError(f"there is no preset {brief(name)}; choose from {', '.join(PRESETS)}")
    return PRESETS[name]


def for_events(config: Config) -> Config:
    """``config`` for images of events, where it does not say otherwise: the input ``events``, three views, and the
    decoder ``standard``, chosen by ``python -m benchmarks events.lens --choose``. The conductance network takes pixels.
    """
    if isinstance(config.network, ConductanceNetwork):
        return config
    encoder, views, decoder = config.encoder, config.views, config.decoder
    if encoder.kind == EncoderConfig.kind:
        encoder = replace(encoder, kind="events")
    if len(views.views) == 1:
        views = replace(views, shifts=3)
    if decoder.default == DecoderConfig.default:
        decoder = replace(decoder, default="standard")
    return replace(config, encoder=encoder, views=views, decoder=decoder)


class IntegerConfig(Config):
    """The settings of an integer network, as `integer_config` returns them.

    Only type checkers see this class: an accepted value keeps its type `Config`.
    """

    network: LifNetwork
    learning: StdpLearning


def as_integer_config(config: Config) -> IntegerConfig | None:
    """``config`` itself if it describes an integer network, else None."""
    integer = isinstance(config.network, LifNetwork) and isinstance(config.learning, StdpLearning)
    return cast(IntegerConfig, config) if integer else None


def integer_config(config: Config, purpose: str, path: Path | None = None) -> IntegerConfig:
    """``config`` itself, seen to describe an integer network.

    Args:
        config: The settings.
        purpose: What needs an integer network; the message begins with it.
        path: The file that the settings are from, if it is known.
    Raises:
        ConfigError: the settings are those of the float conductance model.
    """
    settings = as_integer_config(config)
    if settings is None:
        raise CONDUCTANCE.refusal(purpose, path)
    return settings
