"""Runs the network of the bundle around it on a Loihi 2 board, or in Lava's bit-accurate simulation.

    python run.py --check                    everything but the board: files, Lava, lava-loihi, a configured host
    python run.py --self-test [N]            present the (first N) references; counts must be those of the bundle
    python run.py --ladder FILE              all self-tests: networks of a few neurons, each of which shows one thing,
                                             then references; FILE, JSON, is what to send back
    python run.py --queries Q --out R        Q/rates.npy uint16 (n, inputs) in units of 2^-16 spikes a step and
                                             Q/keys.npy uint64 (n,) in; R/counts.npy int32 (n, neurons) out;
                                             if there are, Q/biases.npy int32 (n, neurons) and Q/exponents.npy int32
                                             (n,): mantissas and exponent of each query's biases
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
import contextlib
import importlib.metadata
import importlib.util
import json
import os
import signal
import sys
from functools import partial
from pathlib import Path
from typing import Any

sys.dont_write_bytecode = True  # nothing is added to the bundle, though Lava executes these files again
try:
    from first_look import bundle_of, look

    if __name__ == "__main__":
        look(__file__, "loihi2", sys.argv[1:])
    from bundle_files import intact, read_files, read_manifest
    from command_line import parsed, parser
    from ladder import climb, kept, see_to
    from lava_network import VENDOR
    from lava_worker import work
    from lifetime import keep
    from query_files import Results, load_queries, load_references, named_array
    from references import compare, fewest
    from refusals import Refused, interrupt
    from rungs import Rung, rungs
    from small_network import small_network
    from worker_process import GRACE, run
except Exception as damage:
    place = os.path.dirname(os.path.abspath(__file__))
    sys.exit(f"{place}: is damaged ({damage}); deploy the model again or fetch an intact copy")

FORMAT, VERSION, TARGET = "lava-vpr bundle", 1, "loihi2"


def read_bundle(folder: str) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Manifest, and content of every file in it; refuses what is missing, altered or for another board."""
    manifest = read_manifest(folder)
    kind = (manifest["format"], manifest["version"], manifest["target"])
    if kind != (FORMAT, VERSION, TARGET):
        path = os.path.join(folder, "manifest.json")
        raise Refused("bundle", f"{path}: is {kind[0]} {kind[1]} for {kind[2]}, not {FORMAT} {VERSION} for {TARGET}")
    return manifest, read_files(folder, manifest)


def require(simulate: bool) -> str:
    """See that Lava, and for the board the vendor's part and a host, are here; what was found."""
    if sys.version_info[:2] != (3, 10):
        found = ".".join(map(str, sys.version_info[:3]))
        raise Refused("missing", f"lava-nc 0.10 needs Python 3.10, this is {found}; run this program with Python 3.10")
    try:
        version = importlib.metadata.version("lava-nc")
    except importlib.metadata.PackageNotFoundError:
        raise Refused("missing", "lava-nc is not installed: pip install lava-nc==0.10.*") from None
    if version.split(".")[:2] != ["0", "10"]:
        raise Refused("missing", f"lava-nc {version} is installed, 0.10 is needed: pip install lava-nc==0.10.*")
    if simulate:
        return f"lava-nc {version}, simulated"
    if importlib.util.find_spec("lava.utils.loihi2_profiler") is None:
        raise Refused("missing", f"lava-loihi is not installed; it is {VENDOR}; --simulate needs none")
    if os.environ.get("SLURM") != "1" and not os.environ.get("NXSDKHOST"):
        raise Refused("missing", "no Loihi host is configured; set SLURM=1 or NXSDKHOST=ADDRESS; --simulate needs none")
    return f"lava-nc {version}, lava-loihi, host {os.environ.get('NXSDKHOST') or 'by SLURM'}"


def check_power(simulate: bool, bias_input: bool) -> None:
    """Refuse what cannot be measured: lava-loihi's profiler is attached before one run and read after it."""
    if simulate:
        raise Refused("input", "--power needs the board, without --simulate")
    if bias_input:
        raise Refused(
            "input",
            "--power needs all queries in one run, but the inputs of this bundle integrate biases that are written "
            "between runs; deploy the model with --input-mode injected, and measure that bundle",
        )


def answer(files: dict[str, bytes], network: dict[str, int], args: argparse.Namespace) -> str:
    """Present queries, or references; what was done."""
    if args.queries is not None:
        arrays = load_queries(Path(args.queries), network["inputs"], network["neurons"])
        if args.power and "biases" in arrays:
            raise Refused(
                "input",
                "--power needs all queries in one run, which biases of each query interrupt; leave out biases.npy",
            )
    else:
        arrays, places = load_references(files, args.self_test, network["inputs"])
    n = len(arrays["keys"])
    results = Results(n, network["neurons"], args.out)
    try:
        run(files, arrays, args, results)
        if args.queries is not None:
            return f"{n} of {n} queries answered"
        return compare(results.counts, arrays["labels"], places, named_array(files["host/responses.npy"], "responses"))
    except (Refused, KeyboardInterrupt) as error:
        stage, text = (error.stage, str(error)) if isinstance(error, Refused) else ("run", "interrupted")
        with contextlib.suppress(Refused):
            results.save(stage, text)
        if stage in ("run", "start"):
            text += results.answered()
        raise Refused(stage, text) from None


def ladder(files: dict[str, bytes], network: dict[str, int], args: argparse.Namespace, about: dict[str, Any]) -> str:
    """Climb the ladder of self-tests, and write the file; what was found."""
    see_to(args.ladder)

    def ask(rung: Rung) -> Any:
        small, arrays = small_network(files, rung)
        results = Results(rung.presentations, len(rung.weights[0]), "")
        run(small, arrays, args, results)
        return results.counts

    def self_test(n: int) -> str:
        return answer(files, network, argparse.Namespace(**{**vars(args), "self_test": n}))

    lateral = int(network["inhibition"]) << int(network["inhibition_exponent"])
    climbed = rungs(int(network["bits"]), bool(network["signed"]), lateral, int(network["steps"]))
    references = {
        "one reference": lambda: self_test(fewest(named_array(files["host/labels.npy"], "labels"))),
        "all references": lambda: self_test(0),
    }
    parameters = json.loads(files["network/parameters.json"])
    shape = int(parameters["steps"]), int(parameters["silent_steps"])
    return kept(args.ladder, climb(climbed, ask, shape, references, about))


def main(words: list[str]) -> int:
    """Do what the command line says; the exit code."""
    args = parsed(parser("Loihi 2"), words)
    signal.signal(signal.SIGTERM, interrupt)
    try:
        folder = bundle_of(__file__)
        manifest, files = read_bundle(folder)
        if args.check:
            print(intact(folder, TARGET), flush=True)
        if args.power:
            check_power(args.simulate, bool(manifest["network"].get("bias_input")))
        found, network = require(args.simulate), manifest["network"]
        if args.check:
            print(f"ready: {network['neurons']} neurons, {network['inputs']} inputs; {found}")
        elif args.ladder:
            about = {"board": "Loihi 2", "bundle": manifest["sha256"], "simulated": args.simulate, "lava": found}
            print(ladder(files, network, args, about))
        else:
            print(answer(files, network, args))
    except Refused as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        given = Path(sys.argv[2])
        sys.exit(keep(given, int(sys.argv[3]), partial(work, given), GRACE))
    sys.exit(main(sys.argv[1:]))
