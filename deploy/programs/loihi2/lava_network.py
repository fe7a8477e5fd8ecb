"""The network of the bundle in Lava, and how queries are presented to it."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from input_draws import biases, draw_spikes, phases, regular_spikes
from refusals import Refused

Arrays = dict[str, NDArray[Any]]
VENDOR = "Intel's closed package, from its neuromorphic research cloud"


def shared(shape: tuple[int, ...], kind: Any) -> NDArray[Any]:
    """Zeros that forked processes share with this one."""
    size = max(1, int(np.prod(shape)) * np.dtype(kind).itemsize)
    return np.frombuffer(mmap.mmap(-1, size), kind, int(np.prod(shape))).reshape(shape)


def define_processes() -> None:
    """Make Spikes and Counter; Lava finds the models of a Process among the names of its module."""
    from lava.magma.core.decorator import implements, requires
    from lava.magma.core.model.py.model import PyLoihiProcessModel
    from lava.magma.core.model.py.ports import PyInPort, PyOutPort
    from lava.magma.core.model.py.type import LavaPyType
    from lava.magma.core.process.ports.ports import InPort, OutPort
    from lava.magma.core.process.process import AbstractProcess
    from lava.magma.core.resources import CPU
    from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol

    class Spikes(AbstractProcess):
        """Sends the rows of a shared array, the first in step ``first[0] + 1``."""

        def __init__(self, spikes: NDArray[np.uint8], first: NDArray[np.int64]) -> None:
            super().__init__(spikes=spikes, first=first)
            self.s_out = OutPort(shape=spikes.shape[1:])

    class Counter(AbstractProcess):
        """Counts spikes of each presentation, and the steps that it sees, in shared arrays."""

        def __init__(self, counts: NDArray[np.int32], interval: int, seen: NDArray[np.int64]) -> None:
            super().__init__(counts=counts, interval=interval, seen=seen)
            self.s_in = InPort(shape=counts.shape[1:])

    @implements(proc=Spikes, protocol=LoihiProtocol)
    @requires(CPU)
    class PySpikes(PyLoihiProcessModel):
        s_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, np.int32, precision=24)

        def run_spk(self) -> None:
            row = self.time_step - 1 - int(self.proc_params["first"][0])
            if not 0 <= row < len(self.proc_params["spikes"]):
                raise IndexError(f"step {self.time_step} is outside the batch")
            self.s_out.send(self.proc_params["spikes"][row].astype(np.int32))

    @implements(proc=Counter, protocol=LoihiProtocol)
    @requires(CPU)
    class PyCounter(PyLoihiProcessModel):
        s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, np.int32, precision=24)

        def run_spk(self) -> None:
            fired = self.s_in.recv() != 0
            self.proc_params["counts"][(self.time_step - 1) // self.proc_params["interval"]] += fired
            self.proc_params["seen"][0] += 1

    globals().update(Spikes=Spikes, Counter=Counter, PySpikes=PySpikes, PyCounter=PyCounter)


def across(out: Any, into: Any, adapter: str | None) -> None:
    """Connect two ports, with an ``adapter`` of the vendor's between host and chip."""
    if adapter is None:
        out.connect(into)
        return
    from lava.proc.embedded_io import spike  # of lava-loihi

    between = getattr(spike, adapter)(shape=out.shape)
    out.connect(between.inp)
    between.out.connect(into)


def between(source: Any, connection: Any, target: Any) -> None:
    """Connect two populations by synapses."""
    source.s_out.connect(connection.s_in)
    connection.a_out.connect(target.a_in)


def wire(weights: NDArray[Any], bias: Arrays, parameters: dict[str, Any], ends: tuple[Any, Any], simulate: bool) -> Any:
    """Inputs, or their relays, to exc; exc to inh, which inhibits every exc; exc to the counter: the two ``ends``.

    Every arrow takes one step. Inh are the leaves, if there are any, and the root, the last. Exc begin with the Vars
    ``bias``, and are returned.
    """
    from lava.proc.dense.process import Dense
    from lava.proc.lif.process import LIF, LIFReset
    from lava.proc.sparse.process import Sparse
    from lava.utils.weightutils import SignMode
    from scipy.sparse import csr_matrix, identity

    def synapses(name: str, given: Any, kind: Any = Dense) -> Any:
        form = {key: value for key, value in parameters[name].items() if key != "weight"}
        return kind(weights=given, **form | {"sign_mode": SignMode[form["sign_mode"]]})

    (source, counter), (n, inputs), leaves = ends, weights.shape, parameters["leaves"]
    one, lateral = parameters["relay"]["weight"], parameters["inhibit"]["weight"]
    excite = synapses("excite", weights.astype(np.int32))
    exc = LIFReset(shape=(n,), **parameters["exc"] | bias)
    inh = LIFReset(shape=(leaves + 1,), **parameters["inh"])
    if leaves:
        own = np.arange(n) // parameters["fan_in"]
        listen = csr_matrix((np.full(n, one, np.int32), (own, np.arange(n))), (leaves + 1, n))
        gather = csr_matrix((np.full(leaves, one, np.int32), (np.full(leaves, leaves), np.arange(leaves))))
        gather.resize(leaves + 1, leaves + 1)
        take = csr_matrix((np.full(n, lateral, np.int32), (np.arange(n), np.full(n, leaves))), (n, leaves + 1))
        between(exc, synapses("relay", listen, Sparse), inh)
        between(inh, synapses("relay", gather, Sparse), inh)
        between(inh, synapses("inhibit", take, Sparse), exc)
    else:
        between(exc, synapses("relay", np.full((1, n), one)), inh)
        between(inh, synapses("inhibit", np.full((n, 1), lateral)), exc)
    entrance = excite.s_in
    if parameters["relayed"]:
        forward = synapses("relay", one * identity(inputs, np.int32, "csr"), Sparse)
        relays = LIFReset(shape=(inputs,), **parameters["inh"])
        forward.a_out.connect(relays.a_in)
        relays.s_out.connect(excite.s_in)
        entrance = forward.s_in
    excite.a_out.connect(exc.a_in)
    across(source.s_out, entrance, None if isinstance(source, LIF) or simulate else "PyToNxAdapter")
    across(exc.s_out, counter.s_in, None if simulate else "NxToPyAdapter")
    return exc


def start_board(process: Any, callbacks: list[Any]) -> None:
    """Compile for the board, and see that nothing but the two ends runs on the CPU, which Lava does without a word.

    ``callbacks`` are called before and after a run.
    """
    from lava.magma.core.model.py.model import AbstractPyProcessModel
    from lava.magma.core.run_configs import Loihi2HwCfg

    ends = (globals()["Spikes"], globals()["Counter"])
    try:
        executable = process.compile(Loihi2HwCfg(callback_fxs=callbacks))
    except NameError as error:
        raise Refused(
            "missing", f"Loihi2HwCfg finds no models for the chip ({error}); install lava-loihi, {VENDOR}"
        ) from None
    parts = [part for part in executable.process_list if not isinstance(part, ends)]
    found = sorted(f"{type(p).__name__} ({p.model_class.__name__})" for p in parts if on_cpu(p, AbstractPyProcessModel))
    if found:
        raise Refused(
            "missing", f"Loihi2HwCfg would run on the CPU: {', '.join(found)}; install lava-loihi for lava-nc 0.10"
        )
    process.create_runtime(executable=executable)


def write(process: Any, values: Arrays) -> None:
    """Set Vars of a Process while the run is paused."""
    for name, value in values.items():
        getattr(process, name).set(value)


def on_cpu(process: Any, base: type) -> bool:
    """Whether Lava picked a Python model for a Process."""
    return issubclass(process.model_class, base)


class CountedRun:
    """A network in Lava, whose spikes of exc are counted; ``seen`` counts the steps that were read out."""

    def __init__(self, options: dict[str, Any], seen: NDArray[np.int64], queries: int, neurons: int) -> None:
        parameters = options["parameters"]
        self.steps, self.silent = parameters["steps"], parameters["silent_steps"]
        self.interval, self.simulate = self.steps + self.silent, options["simulate"]
        self.counts, self.seen, self.started = shared((queries, neurons), np.int32), seen, False
        self.profiler = None
        if options.get("power"):
            from lava_power import Profiler

            self.profiler = Profiler(queries * self.interval)
        self.process = globals()["Counter"](self.counts, self.interval, self.seen)

    def start(self) -> None:
        """What is wired is compiled, but for a simulation."""
        if not self.simulate:
            start_board(self.process, self.profiler.callbacks if self.profiler else [])

    def go(self, steps: int) -> None:
        """Run Lava for ``steps`` steps."""
        from lava.magma.core.run_conditions import RunSteps
        from lava.magma.core.run_configs import Loihi2SimCfg

        config = None if self.started or not self.simulate else Loihi2SimCfg(select_tag="fixed_pt")
        self.process.run(condition=RunSteps(num_steps=steps), run_cfg=config)
        self.started = True

    def covered(self, start: int, end: int) -> NDArray[np.int32]:
        """Counts of the queries ``start`` .. ``end`` - 1, of which every step was read out."""
        if self.seen[0] != end * self.interval:
            raise Refused(
                "run",
                f"queries {start} to {end - 1}: the read-out covers {self.seen[0] - start * self.interval:,} of "
                f"{(end - start) * self.interval:,} steps; run them again, and see to the board if it happens again",
            )
        return self.counts[start:end]


class Player(CountedRun):
    """The network of places, and how a batch is presented to it."""

    def __init__(self, arrays: Arrays, options: dict[str, Any], seen: NDArray[np.int64]) -> None:
        from lava.proc.lif.process import LIF

        self.rates, self.keys, weights = arrays["rates"], arrays["keys"], arrays["weights"]
        super().__init__(options, seen, len(self.rates), len(weights))
        parameters = options["parameters"]
        self.level = parameters["level"]
        batch, inputs = min(options["batch"], len(self.rates)), weights.shape[1]
        self.first, self.inputs = shared((1,), np.int64), parameters["inputs"]
        if self.inputs is None:
            self.spikes = shared((batch * self.interval, inputs), np.uint8)
            self.source: Any = globals()["Spikes"](self.spikes, self.first)
        else:  # a Var cannot be set before the first step, so the first query's values are those it begins with
            begin = {"bias_mant": 0, "bias_exp": 0, "v": 0} if options["scalars"] else self.registers(0)
            self.source = LIF(shape=(inputs,), **begin, **self.inputs)
        pairs = zip(arrays.get("biases", ()), arrays.get("exponents", ()), strict=True)
        self.biases = [{"bias_mant": row, "bias_exp": np.full_like(row, exponent)} for row, exponent in pairs]
        bias = self.biases[0] if self.biases else {"bias_mant": arrays["bias"]}
        if options["scalars"]:
            bias, own = {"bias_mant": 0}, [bias] * len(self.rates) if arrays["bias"].any() else []
            self.biases = self.biases or own
        self.exc = wire(weights, bias, parameters, (self.source, self.process), self.simulate)
        self.start()

    def registers(self, query: int, before: int = 0) -> Arrays:
        """Of the inputs, ``before`` steps before a query begins: its bias leads the membrane to its phase."""
        mantissa, exponent = biases(self.rates[query], self.level)
        v = phases(int(self.keys[query]), self.rates.shape[1], self.level) - before * (mantissa << exponent)
        return {"bias_mant": mantissa, "bias_exp": exponent, "v": v}

    def drawn(self, query: int) -> NDArray[Any]:
        """The spikes to inject for a query, bool (steps, inputs)."""
        rates, key = self.rates[query], int(self.keys[query])
        if self.level is None:
            return draw_spikes(rates, key, self.steps)
        return regular_spikes(rates, key, self.steps, self.level)

    def present(self, start: int, end: int) -> NDArray[np.int32]:
        """Counts of the queries ``start`` .. ``end`` - 1."""
        if self.inputs is None:
            train = self.spikes[: (end - start) * self.interval].reshape(end - start, self.interval, -1)
            train[:] = 0
            for row, query in zip(train, range(start, end), strict=True):
                row[: self.steps] = self.drawn(query)
            self.first[0] = start * self.interval
            if not self.biases:
                self.go((end - start) * self.interval)
        for query in range(start, end) if self.biases or self.inputs else ():
            following = min(query + 1, len(self.rates) - 1)
            self.go(self.steps)
            if self.inputs is not None:
                # Phases are below the threshold, so in the silent steps nothing spikes, and one pause is enough.
                write(self.source, self.registers(following, self.silent))
            self.go(self.silent)
            if self.biases and query < following:
                write(self.exc, self.biases[following])
        return self.covered(start, end)
