"""Runs the network of the bundle around it on Kapoho Bay (two Loihi 1 chips), by Intel's NxSDK and numpy alone.

    export KAPOHOBAY=1                       NxSDK looks for this board then
    python run.py --check                    everything but the board: files (without numpy or NxSDK), NxSDK, registers
    python run.py --self-test [N]            present the (first N) references; counts must be those of the bundle
    python run.py --ladder FILE              all self-tests: networks of a few neurons, each of which shows one thing,
                                             then references; FILE, JSON, is what to send back
    python run.py --queries Q --out R        Q/rates.npy uint16 (n, inputs) in units of 2^-16 spikes a step and
                                             Q/keys.npy uint64 (n,) in; R/counts.npy int32 (n, neurons) out;
                                             if there are, Q/biases.npy int32 (n, neurons) and Q/exponents.npy int32
                                             (n,): mantissas and exponent of each query's biases; or, of a bundle with
                                             gains, Q/activity.npy float32 (n, inputs) alone, of the same images;
                                             of a bundle that takes pixels, Q/pixels.npy uint8 (n, rows, columns)
                                             in place of rates and keys
    .. --ways W,W                            other ways to ask NxSDK, which --ladder finds and names (LAVA_VPR_WAYS)
    .. --power P                             and P, JSON: power in mW and time, all queries in one run
    .. --simulate                            the registers in numpy, without a board and without NxSDK

R/counts.npy holds -1 in every row that was not answered, R/done.npy says which were, R/status.json how many. They are
replaced, each in one step, after every batch and when anything goes wrong: what was answered is kept, nothing is
invented. If NxSDK raised an exception, R/failure.txt has its traceback. Exit code 0: all done; 1: not, with one line on
stderr that says why.

This needs Python 3.6 with numpy 1.17 or later and the files beside it, not lava-vpr. `embedded.c` runs on the chips and
says how the two talk. Each name of NxSDK stands in lava-vpr's docs/hardware.md, with its public source or the
word unproven.
"""

import argparse
import contextlib
import os
import sys
import time
import traceback
from typing import Any, Callable, Dict, FrozenSet, Iterator, List

sys.dont_write_bytecode = True  # nothing is added to the bundle
try:
    from first_look import look

    if __name__ == "__main__":
        look(__file__, "kapoho-bay", sys.argv[1:])
    import numpy as np

    import board_power
    import host
    from attempts import Attempts
    from board_device import Device, check_environment, load_nxsdk
    from board_input import Query
    from board_network import Network
    from board_ways import WAYS
    from bundle_files import Bundle
    from ladder import Attempt
    from layer_rungs import layer_rungs
    from refusals import Refused, told
    from result_files import Results, put
    from simulated import Simulation
    from small_network import SmallNetworks, tables_rung
    from watchdog import GRACE, Watchdog
except Exception as damage:
    place = os.path.dirname(os.path.abspath(__file__))
    sys.exit(f"{place}: is damaged ({damage}); deploy the model again or fetch an intact copy")


class KapohoBay(host.Host):
    """The network of a bundle on the board, or its registers in numpy."""

    title, target, ways = "Kapoho Bay", "kapoho-bay", WAYS

    def __init__(self, bundle: Bundle, options: argparse.Namespace) -> None:
        super().__init__(bundle, options)
        self.network = Network(bundle)

    def require(self) -> Dict[str, Any]:
        """See that NxSDK is here and, but for ``--check``, that a board is announced to it."""
        if not self.options.simulate:
            load_nxsdk()
            if not self.options.check:
                check_environment()
        return {"nxsdk": getattr(sys.modules.get("nxsdk"), "__version__", None)}

    def ready(self) -> str:
        """Configure the network."""
        cores = self.network.cores
        text = f"{len(cores)} cores, {sum(core.synapses for core in cores)} synapses, {self.neurons} neurons"
        if self.options.simulate:
            Simulation(self.network)
            return "ready to simulate: " + text
        Device(self.network).close()
        announced = os.environ.get("KAPOHOBAY") == "1"
        return f"ready: {text}" + ("" if announced else "; set KAPOHOBAY=1 to run on the board")

    def present(self, arrays: host.Arrays, results: Results) -> None:
        """Present all queries, ``--batch`` in a run of the board; for ``--power`` all in one run."""
        network, direct = self.network, self.network.direct
        rates = arrays["pixels" if direct else "rates"]
        keys = np.zeros(len(rates), np.uint64) if direct else arrays["keys"]
        biases = (arrays["biases"], arrays["exponents"]) if "biases" in arrays else None
        network.adapted = biases is not None

        def query(i: int) -> Query:
            return Query(network, i, rates[i], int(keys[i]), biases)

        for i in range(len(keys)):  # before the board starts: nothing is begun that cannot be finished
            query(i)
        if self.options.simulate:
            simulation = Simulation(network)
            for i in range(len(keys)):
                results.put(i, simulation.counts(query(i)))
            results.save()
        else:
            ask_board(network, query, len(keys), results, self.options)

    def silent(self) -> int:
        """As the manifest has it."""
        return self.network.silent

    def further(self) -> List[Any]:
        """A rung for every format of synapses that the bundle has and no other rung uses, and for every layer of its
        front end."""
        self.small = SmallNetworks(self.network)
        layers = layer_rungs(self.network.steps, heard=self.network.direct) if self.small.layers else []
        if self.network.direct:
            return list(layers)
        formats = [rung for rung, _ in self.small.own.values()]
        return [*formats, tables_rung(*self.bundle.numbers("bits")), *layers]

    def plain(self) -> List[Any]:
        """None where nothing is injected: rungs of the layers show what such a bundle needs."""
        return [] if self.network.direct else super().plain()

    def use(self, ways: FrozenSet[str]) -> None:
        """The network that is configured knows them."""
        self.network.ways = ways

    @contextlib.contextmanager
    def attempts(self) -> Iterator[Attempt]:
        """In a process of their own: NxSDK's calls have no time limits, and one that hangs costs one attempt."""
        if self.options.simulate:
            yield self.attempt
            return
        queries = len(self.bundle.array("host/labels.npy"))
        with Attempts(os.path.join(self.bundle.folder, "program", "run.py"), self.options, queries) as attempts:
            yield attempts

    def ask(self, rung: Any) -> np.ndarray:
        """On one core."""
        small, queries = rung.built(self.small)
        if self.options.simulate:
            return np.array([Simulation(small).counts(query) for query in queries])
        results = Results(len(queries), small.neurons)
        ask_board(small, queries.__getitem__, len(queries), results, self.options)
        return results.counts


def ask_board(
    network: Network, query: Callable[[int], Any], n: int, results: Results, options: argparse.Namespace
) -> None:
    """Present ``n`` queries, each made by ``query``, to the board, ``options.batch`` in a run.

    A run may take ``options.timeout`` seconds (0: by its size). With ``options.power`` all queries are one run, of
    which power is measured, and written there.
    """
    steps = 2 + n * (network.steps + network.silent)
    batch = n if options.power else options.batch
    device = Device(network, steps if options.power else 0)
    try:
        device.start()
        for first in range(0, n, batch):
            part = range(first, min(first + batch, n))
            seconds = options.timeout or 60.0 + 10.0 * len(part)
            text = f"queries {part[0]} to {part[-1]}: the board did not finish within {seconds:g} s"
            with Watchdog(seconds + min(GRACE, seconds), "run", text):
                try:
                    sent = [query(i) for i in part]
                    device.answer(sent, first + 1, time.monotonic() + seconds, results)
                except Refused:
                    raise
                except Exception as error:
                    text = f"queries {part[0]} to {part[-1]}: the board failed ({told(error)})"
                    raise Refused("run", text, traceback.format_exc()) from None
    finally:
        device.close()
    if options.power:
        put(options.power, board_power.figures(device.board, steps))


def main(words: list) -> int:
    """Do what the command line says; the exit code."""
    return host.main(KapohoBay, __file__, words)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
