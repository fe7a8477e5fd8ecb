"""Hierarchical Processes: whole networks, wired from others, and one that is a single fast Process."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import check_thresholds, need
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.engine.inference.counting import EVENTS, count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.learning.integer import IntegerLearning
from lava_vpr.engine.learning.stdp import PlasticState
from lava_vpr.loihi import INPUT_SHIFT, THRESHOLD_LIMIT
from lava_vpr.neurons.models import NEURONS
from lava_vpr.processes.base.magma import (
    AbstractSubProcessModel,
    CheckedProcess,
    LavaPyType,
    LoihiProtocol,
    PyLoihiProcessModel,
    Var,
    check_outputs,
    check_presentations,
    implements,
    model_of,
    whole,
)
from lava_vpr.processes.base.network import NetworkProcess
from lava_vpr.processes.base.neurons import BiasTable
from lava_vpr.processes.base.wiring import RELAY_WEIGHT, exact_mantissa, gathering, inhibiting, listening, wire
from lava_vpr.processes.lif.process import ExcitatoryLIF, InhibitoryLIF
from lava_vpr.processes.plastic_dense.process import PlasticDense
from lava_vpr.processes.synapses.process import DenseSynapses, OneToOne


class PlaceNetwork(NetworkProcess):
    """`FixedNetwork` composed of DenseSynapses, ExcitatoryLIF and InhibitoryLIF, and OneToOne before relays.

    A run that prefers SubProcessModels uses Lava's LIFReset, Dense and Sparse instead, and nothing else: what a board
    can run. It takes the biases of one presentation; `write_bias` sets the others between runs.

    Ports: ``s_in`` spikes (inputs,), ``s_out`` spikes of exc (neurons,), ``s_out_inh`` those of inh (inhibitory,): the
    leaves, then the root. Vars: ``weights`` (neurons, inputs), ``u``, ``v``, ``vth`` of exc (neurons,), ``v_inh``
    (inhibitory,), ``lateral_weights`` (neurons, inhibitory), mantissas from inh (columns) to exc (rows), at most 0
    (with Lava's library and leaves a sparse matrix), ``bias_mant``, ``bias_exp`` of exc (neurons,).
    """

    def __init__(self, *, network: FixedNetwork, bias: NDArray[np.int32] | None = None, **kwargs: Any) -> None:
        """Make the network of the spec ``network``; its models wire the parts.

        Args:
            network: What to run.
            bias: Biases in units of v of each presentation, int32 (n, neurons); None: always the network's.
        Raises:
            NetworkLimitError: the network could overflow Loihi's registers, or they cannot hold the biases.
            InputError: biases of another type or shape.
        """
        NEURONS[network.model].check(type(self).__name__)
        network.check()
        if bias is not None:
            network.check_presented(bias, len(bias))
        laterals, interval = inhibiting(network), network.interval
        numbers = {"network": network, "bias": bias, **kwargs}
        super().__init__(network.stored[0], network.threshold, laterals, interval, **numbers)
        self.network, self.bias = network, bias
        self.bias_mant, self.bias_exp = Var(shape=(network.neurons,)), Var(shape=(network.neurons,))

    def write_bias(self, bias: NDArray[np.int32], floating: bool = False) -> None:
        """Set the biases while the run is paused, from the next step on.

        Args:
            bias: In units of v, int32 (neurons,).
            floating: The run is of Lava's own floating-point models, which ignore exponents.
        """
        mantissas, exponent = bias_registers(bias)
        values: dict[str, NDArray[Any]] = {"bias_mant": mantissas, "bias_exp": np.full_like(mantissas, exponent)}
        if floating:
            values = {"bias_mant": bias * 2.0**-INPUT_SHIFT}
        for name, value in values.items():
            getattr(self, name).set(value)


@implements(proc=PlaceNetwork, protocol=LoihiProtocol)
class SubPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc, exc to inh, and inh inhibits every exc. Every connection takes one step."""

    def __init__(self, proc: PlaceNetwork) -> None:
        network, interval = proc.network, proc.interval
        weights, bits, exponent = network.stored
        bias, bias_exponent = network.bias_registers
        self.excite = DenseSynapses(
            weights=weights,
            num_weight_bits=bits,
            weight_exp=exponent,
            sign_mode="mixed" if network.signed else "excitatory",
        )
        self.exc = ExcitatoryLIF(
            shape=(network.neurons,),
            dv=network.decay,
            vth=network.threshold,
            bias_mant=bias,
            bias_exp=bias_exponent,
            reset_interval=interval,
            bias_table=None if proc.bias is None else BiasTable(*bias_registers(proc.bias)),
        )
        sparse = network.leaves > 0
        self.listen = DenseSynapses(weights=listening(network), sparse=sparse)
        self.inh = InhibitoryLIF(shape=(network.inhibitory,), reset_interval=interval)
        self.inhibit = DenseSynapses(
            weights=inhibiting(network),
            weight_exp=network.inhibition_exponent,
            sign_mode="inhibitory",
            sparse=sparse,
        )
        if network.leaves:
            self.gather = DenseSynapses(weights=gathering(network), sparse=True)
        if network.relayed:
            self.forward = OneToOne(shape=(network.inputs,), weight=RELAY_WEIGHT)
            self.relays = InhibitoryLIF(shape=(network.inputs,), reset_interval=interval)
        wire(proc, self)
        proc.vars.bias_mant.alias(self.exc.bias_mant)
        proc.vars.bias_exp.alias(self.exc.bias_exp)


class FusedPlaceNetwork(CheckedProcess):
    """`FixedNetwork` with its input, by the compiled kernel of the host engine: bit-exact integers only.

    **One Lava step is a whole presentation, of ``batch`` images at once**: step t presents the images
    (t - 1) batch .. t batch - 1, and `batches` steps present all. It has no ports. Vars: ``counts`` int32 (n, neurons),
    ``events`` int64, as `EVENTS`. Reading a large Var is slow; give shared arrays instead.
    """

    def __init__(
        self,
        *,
        network: FixedNetwork,
        rates: NDArray[np.uint16],
        keys: NDArray[np.uint64],
        bias: NDArray[np.int32] | None = None,
        batch: int = 64,
        ahead: bool = True,
        counts: NDArray[np.int32] | None = None,
        raster: NDArray[np.uint8] | None = None,
        events: NDArray[np.int64] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the Process that presents all images to ``network``.

        Args:
            network: What to run.
            rates: Spike probabilities in units of 2^-16, uint16 (n, inputs).
            keys: One key per presentation, uint64 (n,).
            bias: Biases in units of v of each presentation, int32 (n, neurons); None: always the network's.
            batch: Images of one Lava step.
            ahead: Compute the next step's images while Lava turns to it; else each step does its own, to be timed.
            counts, events: Shared arrays for the results, besides the Vars; the Vars' shapes and types.
            raster: Shared array for every excitatory spike, uint8 (n, interval, neurons).
        Raises:
            NetworkLimitError: a network that could overflow Loihi's registers, biases that they cannot hold, or arrays
                of another type or shape.
            InputError: biases of another type or shape.
        """
        NEURONS[network.model].check(type(self).__name__)
        network.check()
        check_presentations("FusedPlaceNetwork", rates, keys)
        fits = len(rates) > 0 and rates.shape[1] == network.inputs
        need(fits, "FusedPlaceNetwork: rates' shape", rates.shape, f"(n, {network.inputs}), n at least 1")
        if bias is not None:
            network.check_presented(bias, len(rates))
        need(whole(batch) and batch >= 1, "batch", batch, "a whole number, at least 1")
        n, shape = len(rates), (len(rates), network.neurons)
        check_outputs(
            "FusedPlaceNetwork",
            counts=(counts, shape, np.int32),
            raster=(raster, (n, network.interval, network.neurons), np.uint8),
            events=(events, (len(EVENTS),), np.int64),
        )
        super().__init__(
            network=network,
            rates=np.ascontiguousarray(rates),
            keys=keys,
            bias=bias,
            batch=int(batch),
            ahead=bool(ahead),
            shared={"counts": counts, "raster": raster, "events": events},
            **kwargs,
        )
        self.batches = -(-n // int(batch))
        self.network = network
        self.counts = Var(shape=shape, init=0)
        self.events = Var(shape=(len(EVENTS),), init=0)

    def compile_kernels(self) -> None:
        """Compile the kernel before the model is forked, and prepare what it reads: by a silent presentation."""
        count_spikes(self.network, np.zeros((1, self.network.inputs), np.uint16), np.zeros(1, np.uint64))


@model_of(FusedPlaceNetwork, "fixed")
class PyFusedPlaceNetworkFixed(PyLoihiProcessModel):
    """Presents a batch of images in each Lava step, in Loihi's integers.

    While Lava advances to the next step, a thread already computes the next batch; its results appear in their own
    step.
    """

    counts: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32)
    events: NDArray[np.int64] = LavaPyType(np.ndarray, np.int64)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.network, self.batch = proc_params["network"], proc_params["batch"]
        self.rates, self.keys = proc_params["rates"], proc_params["keys"]
        self.bias = proc_params["bias"]
        self.shared: dict[str, NDArray[Any] | None] = proc_params["shared"]
        self.look_ahead = bool(proc_params["ahead"])
        self.pool: ThreadPoolExecutor | None = None  # made in the forked process, which would not inherit its thread
        self.ahead: Future[Any] | None = None

    def _present(self, part: slice) -> Any:
        """What `count_spikes` makes of the images ``part``."""
        raster, bias = self.shared["raster"] is not None, None if self.bias is None else self.bias[part]
        return count_spikes(self.network, self.rates[part], self.keys[part], bias=bias, raster=raster)

    def run_spk(self) -> None:
        """Present the next images, if any are left."""
        start, n = (self.time_step - 1) * self.batch, len(self.keys)
        if start >= n:
            return
        part, then = (slice(k, min(k + self.batch, n)) for k in (start, start + self.batch))
        counts, events, film = self.ahead.result() if self.ahead is not None else self._present(part)
        if then.start < n and self.look_ahead:
            self.pool = self.pool or ThreadPoolExecutor(1)
            self.ahead = self.pool.submit(self._present, then)
        raster = self.shared["raster"]
        numbers = np.array([events[name] for name in EVENTS], np.int64)
        self.counts[part] = counts
        self.events += numbers
        if raster is not None:
            raster[part] = film
        if self.shared["counts"] is not None:
            self.shared["counts"][part] = counts
        if self.shared["events"] is not None:
            self.shared["events"] += numbers


class LearningPlaceNetwork(NetworkProcess):
    """`IntegerLearning` composed of PlasticDense, ExcitatoryLIF, InhibitoryLIF, DenseSynapses and OneToOne.

    One inhibitory neuron inhibits every neuron; the relay of a neuron that spiked gives it back in the same step.

    Every presentation of ``keys`` is `engine.learning.integer.present`: weights are normalised and membranes and traces
    cleared in its first step; thresholds are kept. With ``late_theta`` thresholds rise between presentations and by the
    host (`raise_thresholds`), as on a chip. Under ``floating_pt`` the same spec runs without rounding.

    A run that prefers SubProcessModels uses Lava's LIFReset, Dense, Sparse and LearningDense instead of the parts: what
    Intel's compiler could place. It takes ``rng_seed``, one presentation, and the features of the library: one constant
    threshold for all, no floor, no hold, no normalisation. Every spike, weight and trace is equal, too.

    Ports: ``s_in`` spikes (inputs,), ``s_out`` spikes of exc (neurons,), ``s_out_inh`` those of inh (1,). Vars:
    ``weights`` (neurons, inputs), ``x1`` traces (inputs,), ``u``, ``v``, ``vth`` of exc (neurons,), ``v_inh`` (1,),
    ``lateral_weights`` (neurons, 1), mantissas from inh to each neuron, at most 0, and ``own_weights`` (neurons,
    neurons), the same on the diagonal, given back by each neuron's own relay (`set_laterals` writes both).
    """

    def __init__(
        self,
        *,
        learning: IntegerLearning,
        state: PlasticState,
        keys: NDArray[np.uint64],
        rng_seed: int | None = None,
        mantissas: NDArray[np.int64] | None = None,
        record_weights: NDArray[Any] | None = None,
        record_traces: NDArray[Any] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the network for one phase of learning.

        Args:
            learning: One phase of learning.
            state: Weights and thresholds at its start; not changed.
            keys, rng_seed, record_weights, record_traces: See `lava_vpr.processes.plastic_dense.process.PlasticDense`.
            mantissas: What inh takes from each neuron, int64 (neurons,), 0..255; the exponent is that of
                ``learning.inhibition``, whose mantissa is the default for all.
        Raises:
            NetworkLimitError: the network could overflow Loihi's registers, or arrays do not fit each other.
        """
        inputs, neurons = state.weights.shape
        learning.check()
        need(state.theta.shape == (neurons,), "LearningPlaceNetwork: theta", state.theta.shape, f"({neurons},)")
        check_thresholds(state.theta)
        plasticity: dict[str, Any] = {
            "weights": np.ascontiguousarray(state.weights.T),
            "rule": learning.rule,
            "steps": learning.steps,
            "silent_steps": learning.silent_steps,
            "keys": keys,
            "weight_sum": learning.weight_sum,
            "rng_seed": rng_seed,
            "record_weights": record_weights,
            "record_traces": record_traces,
        }
        mantissa, self.exponent = exact_mantissa(learning.inhibition)
        taken = np.full(neurons, mantissa, np.int32) if mantissas is None else mantissas.astype(np.int32)
        super().__init__(plasticity["weights"], state.theta.copy(), -taken[:, None], learning.interval, **kwargs)
        self.learning, self.plasticity = learning, plasticity
        self.x1 = Var(shape=(inputs,), init=0)
        self.own_weights = Var(shape=(neurons, neurons), init=np.diag(taken))

    def set_laterals(self, mantissas: NDArray[np.int64]) -> None:
        """Write what inh takes from each neuron, and what its relay gives back; the run must pause.

        Args:
            mantissas: int64 (neurons,), 0..255.
        """
        values = mantissas.astype(np.int32)
        self.lateral_weights.set(-values[:, None])
        self.own_weights.set(np.diag(values))

    def raise_thresholds(self, counts: NDArray[np.int32]) -> None:
        """Raise the thresholds as the host does after a presentation with ``late_theta``; the run must pause.

        Args:
            counts: Spikes of each neuron in that presentation, (neurons,).
        """
        raised = self.vth.get() + counts * self.learning.neurons.theta_plus
        self.vth.set(np.minimum(raised, THRESHOLD_LIMIT - 1))


@implements(proc=LearningPlaceNetwork, protocol=LoihiProtocol)
class SubLearningPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc by synapses that its spikes change, exc to inh, and inh inhibits every exc.

    Each exc also has a relay, which spikes after it and gives the inhibition back in the same step: winners are
    spared.
    """

    def __init__(self, proc: LearningPlaceNetwork) -> None:
        learning, shape, interval = proc.learning, proc.s_out.shape, proc.interval
        lif = learning.neurons
        self.excite = PlasticDense(**proc.plasticity)
        self.exc = ExcitatoryLIF(
            shape=shape,
            du=lif.du,
            dv=lif.dv,
            vth=proc.vars.vth.init,
            floor=lif.floor,
            hold_steps=lif.hold_steps,
            theta_plus=0 if learning.late_theta else lif.theta_plus,
            reset_interval=interval,
        )
        self.listen = DenseSynapses(weights=np.full((1, *shape), RELAY_WEIGHT))
        self.inh = InhibitoryLIF(shape=(1,), reset_interval=interval)
        self.inhibit = DenseSynapses(
            weights=proc.vars.lateral_weights.init, weight_exp=proc.exponent, sign_mode="inhibitory"
        )
        self.echo = OneToOne(shape=shape, weight=RELAY_WEIGHT)
        self.own = InhibitoryLIF(shape=shape, reset_interval=interval)
        # Not OneToOne: Lava's fixed-point Sparse fails once its weights were set.
        self.give_back = DenseSynapses(
            weights=proc.vars.own_weights.init, weight_exp=proc.exponent, sign_mode="excitatory"
        )
        wire(proc, self)
        self.exc.s_out.connect(self.excite.s_in_post)
        proc.vars.x1.alias(self.excite.x1)
        proc.vars.own_weights.alias(self.give_back.weights)
