"""Runs the network of the bundle around it on a Loihi 2 board, or in Lava's bit-accurate simulation.

    python run.py --check                    everything but the board: files, Lava, lava-loihi, a configured host
    python run.py --self-test [N]            present the (first N) references; counts must be those of the bundle
    python run.py --ladder FILE              all self-tests: networks of a few neurons, each of which shows one thing,
                                             then references; FILE, JSON, is what to send back
    python run.py --queries Q --out R        Q/rates.npy uint16 (n, inputs) in units of 2^-16 spikes a step and
                                             Q/keys.npy uint64 (n,) in; R/counts.npy int32 (n, neurons) out;
                                             if there are, Q/biases.npy int32 (n, neurons) and Q/exponents.npy int32
                                             (n,): mantissas and exponent of each query's biases; or, of a bundle with
                                             gains, Q/activity.npy float32 (n, inputs) alone, of the same images;
                                             of one whose self-test has host/pixels.npy, Q/pixels.npy uint8 in
                                             place of rates and keys
    .. --ways W,W                            other ways to ask Lava, which --ladder finds and names (LAVA_VPR_WAYS)
    .. --power P                             and P, JSON: power in mW and time, all queries in one run

With --simulate no board is needed. R/counts.npy holds -1 in every row that was not answered, R/done.npy says which
were, R/status.json how many. They are replaced, each in one step, after every batch and when anything goes wrong: what
was answered is kept, nothing is invented. Exit code 0: all done; 1: not, with one line on stderr that says why.

This needs Python 3.10, lava-nc 0.10, numpy and scipy, for the board Intel's closed lava-loihi, and the files beside it,
not lava-vpr. All names of lava-loihi are those that public programs use: lava.proc.embedded_io.spike in Intel's lava-dl
and lava-nc, lava.utils.loihi2_profiler in the benchmarks of lava-dl.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

sys.dont_write_bytecode = True  # nothing is added to the bundle, though Lava executes these files again
try:
    from first_look import look

    if __name__ == "__main__":
        look(__file__, "loihi2", sys.argv[1:])
    import numpy as np

    import host
    from bundle_files import Bundle
    from lava_network import VENDOR
    from lava_pixels import ROWS
    from lava_ways import INJECTED, OF_PIXELS, WAYS
    from lava_worker import work
    from lifetime import keep
    from refusals import Refused
    from result_files import Results
    from rungs import Rung
    from small_network import FEW, in_mode, small_network
    from worker_process import GRACE, QUERIES, run
except Exception as damage:
    place = os.path.dirname(os.path.abspath(__file__))
    sys.exit(f"{place}: is damaged ({damage}); deploy the model again or fetch an intact copy")


def require(simulate: bool, any_lava: bool = False) -> str:
    """See that Lava, in this version but with ``any_lava``, and for the board the vendor's part and a host, are here;
    what was found."""
    if sys.version_info[:2] != (3, 10):
        found = ".".join(map(str, sys.version_info[:3]))
        raise Refused("missing", f"lava-nc 0.10 needs Python 3.10, this is {found}; run this program with Python 3.10")
    try:
        version = importlib.metadata.version("lava-nc")
    except importlib.metadata.PackageNotFoundError:
        raise Refused("missing", "lava-nc is not installed: pip install lava-nc==0.10.*") from None
    if version.split(".")[:2] != ["0", "10"] and not any_lava:
        remedy = "pip install lava-nc==0.10.*, or --ways any-lava"
        raise Refused("missing", f"lava-nc {version} is installed, 0.10 is needed: {remedy}")
    if simulate:
        return f"lava-nc {version}, simulated"
    if importlib.util.find_spec("lava.utils.loihi2_profiler") is None:
        raise Refused("missing", f"lava-loihi is not installed; it is {VENDOR}; --simulate needs none")
    if os.environ.get("SLURM") != "1" and not os.environ.get("NXSDKHOST"):
        raise Refused("missing", "no Loihi host is configured; set SLURM=1 or NXSDKHOST=ADDRESS; --simulate needs none")
    return f"lava-nc {version}, lava-loihi, host {os.environ.get('NXSDKHOST') or 'by SLURM'}"


class Loihi2(host.Host):
    """The network of a bundle in Lava, on the board or simulated."""

    title, target, ways = "Loihi 2", "loihi2", WAYS

    def __init__(self, bundle: Bundle, options: argparse.Namespace) -> None:
        self.parameters = bundle.json("network/parameters.json")
        if bundle.direct:
            self.ways = OF_PIXELS
        elif self.parameters["inputs"] is not None:
            self.ways = [INJECTED, *WAYS]
        super().__init__(bundle, options)

    def require(self) -> dict[str, Any]:
        """See to Lava, and that power can be measured, which is done over one run."""
        if self.options.power and self.bundle.direct:
            raise Refused(
                "input",
                "--power needs all queries in one run, but the pixels of this bundle are written between runs; leave "
                "out --power",
            )
        if self.options.power and self.bundle.manifest["network"].get("bias_input"):
            raise Refused(
                "input",
                "--power needs all queries in one run, but the inputs of this bundle integrate biases that are written "
                "between runs; deploy the model with --input-mode injected, and measure that bundle",
            )
        any_lava = "any-lava" in self.taken or bool(self.options.ladder)  # a ladder finds out what another version does
        return {"lava": require(self.options.simulate, any_lava)}

    def ready(self) -> str:
        """There is no more to see to."""
        inputs = f"{self.inputs} {'cells that they hear' if self.bundle.direct else 'inputs'}"
        return f"ready: {self.neurons} neurons, {inputs}; {self.require()['lava']}"

    def present(self, arrays: host.Arrays, results: Results) -> None:
        """Present all queries in a process of its own."""
        if self.options.power and "biases" in arrays:
            raise Refused(
                "input",
                "--power needs all queries in one run, which biases of each query interrupt; leave out biases.npy",
            )
        names = ["weights", "bias"]
        if self.bundle.direct:
            names = [f"{one['name']}/{part}" for one in self.parameters["synapses"] for part in ROWS]
            arrays = {**arrays, "keys": np.zeros(len(arrays["pixels"]), np.uint64)}
        network = {name: self.bundle.array(f"network/{name}.npy") for name in names}
        self._run(self.parameters, network | arrays, results)

    def _run(self, parameters: dict[str, Any], arrays: host.Arrays, results: Results) -> None:
        """Present all queries, in the ways that are taken."""
        if "injected" in self.taken:
            parameters = in_mode(parameters, bias=False)
        every = [arrays]
        if self.options.power and self.taken & {"fresh", "scalars"}:
            raise Refused("input", "--power needs all queries in one run; leave out --ways fresh and scalars")
        if "fresh" in self.taken:
            every = [
                {name: array[i : i + 1] if name in QUERIES else array for name, array in arrays.items()}
                for i in range(len(arrays["keys"]))
            ]
        first = 0
        for given in every:
            run(parameters, given, self.options, results, first, "scalars" in self.taken)
            first += len(given["keys"])

    def plain(self) -> list[Rung]:
        """None of networks that take pixels: what rungs show needs inputs that have rates."""
        return [] if self.bundle.direct else super().plain()

    def further(self) -> list[Rung]:
        """Some rungs in the other input mode, whichever the bundle has."""
        if self.bundle.direct:
            return []
        other = "injected" if self.parameters["inputs"] else "integrated biases"
        return [rung._replace(name=f"{rung.name}, {other}") for rung in self.plain() if rung.name in FEW]

    def silent(self) -> int:
        """As the parameters have it."""
        return int(self.parameters["silent_steps"])

    def ask(self, rung: Rung) -> Any:
        """With Lava's library, in the bundle's own parameters."""
        results = Results(rung.presentations, len(rung.weights[0]))
        other = in_mode(self.parameters, bias=not self.parameters["inputs"])
        parameters = other if "," in rung.name else self.parameters
        self._run(*small_network(parameters, rung), results)
        return results.counts


def main(words: list[str]) -> int:
    """Do what the command line says; the exit code."""
    return host.main(Loihi2, __file__, words)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        given = Path(sys.argv[2])
        sys.exit(keep(given, int(sys.argv[3]), partial(work, given), GRACE))
    sys.exit(main(sys.argv[1:]))
