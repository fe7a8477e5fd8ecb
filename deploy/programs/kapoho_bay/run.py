"""Runs the network of the bundle around it on Kapoho Bay (two Loihi 1 chips), by Intel's NxSDK and numpy alone.

    export KAPOHOBAY=1                       NxSDK looks for this board then
    python run.py --check                    everything but the board: files (without numpy or NxSDK), NxSDK, registers
    python run.py --self-test [N]            present the (first N) references; counts must be those of the bundle
    python run.py --ladder FILE              all self-tests: networks of a few neurons, each of which shows one thing,
                                             then references; FILE, JSON, is what to send back
    python run.py --queries Q --out R        Q/rates.npy uint16 (n, inputs) in units of 2^-16 spikes a step and
                                             Q/keys.npy uint64 (n,) in; R/counts.npy int32 (n, neurons) out;
                                             if there are, Q/biases.npy int32 (n, neurons) and Q/exponents.npy int32
                                             (n,): mantissas and exponent of each query's biases
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
import os
import signal
import sys
import time
import traceback
from typing import Any, Callable

sys.dont_write_bytecode = True  # nothing is added to the bundle
try:
    from first_look import bundle_of, look

    if __name__ == "__main__":
        look(__file__, "kapoho-bay", sys.argv[1:])
    import numpy as np

    import board_power
    from board_device import Device, check_environment, load_nxsdk
    from board_input import Query
    from board_network import TARGET, TITLE, Bundle, Network
    from bundle_files import intact
    from command_line import parsed, parser
    from ladder import climb, kept, see_to
    from outcome import GRACE, Results, Watchdog, fail
    from references import check_biases, check_queries, compare, fewest, first_places
    from refusals import Refused, interrupt, told
    from result_files import put
    from rungs import Rung, rungs
    from simulated import Simulation
    from small_network import format_rungs, formats_of, small_network, small_queries
except Exception as damage:
    place = os.path.dirname(os.path.abspath(__file__))
    sys.exit(f"{place}: is damaged ({damage}); deploy the model again or fetch an intact copy")


def present(
    network: Network,
    queries: tuple,
    results: Results,
    batch: int,
    timeout: float,
    power: str = "",
    simulate: bool = False,
) -> None:
    """Present all queries (rates, keys, and biases or None), ``batch`` in a run of the board, which may take
    ``timeout`` seconds (0: by its size); with ``power``, all in one run, of which power is measured and written
    there. With ``simulate`` no board is asked."""
    rates, keys, biases = queries
    batch, network.adapted = len(keys) if power else batch, biases is not None
    for i, key in enumerate(keys):  # before the board starts: nothing is begun that cannot be finished
        Query(network, i, rates[i], int(key), biases)
    if simulate:
        simulation = Simulation(network)
        for i, key in enumerate(keys):
            results.put(i, simulation.counts(Query(network, i, rates[i], int(key), biases)))
        results.save()
        return
    device = ask_board(
        network, lambda i: Query(network, i, rates[i], int(keys[i]), biases), len(keys), results, batch, timeout, power
    )
    if power:
        put(power, board_power.figures(device.board, 2 + len(keys) * (network.steps + network.silent)))


def ask_board(
    network: Network,
    query: Callable[[int], Any],
    n: int,
    results: Results,
    batch: int,
    timeout: float,
    power: str = "",
) -> Device:
    """Present ``n`` queries of a network, as `present` does, each made by ``query``; the board, let go."""
    load_nxsdk()
    check_environment()
    device = Device(network, 2 + n * (network.steps + network.silent) if power else 0)
    try:
        device.start()
        for first in range(0, n, batch):
            part = range(first, min(first + batch, n))
            seconds = timeout or 60.0 + 10.0 * len(part)
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
    return device


def load_queries(folder: str, network: Network) -> tuple:
    """Rates, keys, and biases or None in ``folder``.

    Raises:
        Refused: they cannot be read or do not fit the network.
    """
    found = []
    names = ["rates.npy", "keys.npy"]
    if os.path.exists(os.path.join(folder, "biases.npy")):
        names += ["biases.npy", "exponents.npy"]
    for name in names:
        try:
            found.append(np.load(os.path.join(folder, name), allow_pickle=False))
        except (OSError, ValueError) as error:
            raise Refused("input", f"{os.path.join(folder, name)}: cannot be read ({told(error)})") from None
    check_queries(found[0], found[1], network.inputs, folder)
    if len(found) == 2:
        return found[0], found[1], None
    check_biases(found[2], found[3], (len(found[1]), network.neurons), folder)
    return found[0], found[1], (found[2], found[3])


def self_test(network: Network, n: int, options: argparse.Namespace) -> str:
    """Present the first ``n`` references (0: all); what was compared.

    Raises:
        Refused: the counts are not those of the bundle.
    """
    array = network.bundle.array
    rates, keys, labels = (array(f"host/{name}.npy") for name in ("rates", "keys", "labels"))
    responses = array("host/responses.npy")
    n, places = first_places(labels, n)
    results = Results(n, network.neurons, options.out)
    present(network, (rates[:n], keys[:n], None), results, options.batch, options.timeout, simulate=options.simulate)
    return compare(results.counts, labels[:n], places, responses)


def ladder(network: Network, options: argparse.Namespace) -> str:
    """Climb the ladder, and write the file; what was found.

    Raises:
        Refused: a rung failed, or there is no board.
    """
    see_to(options.ladder)
    scalars = network.bundle.manifest["network"]
    lateral = int(scalars["inhibition"]) << int(scalars["inhibition_exponent"])
    if not options.simulate:
        load_nxsdk()
        check_environment()

    def ask(rung: Rung) -> np.ndarray:
        small = small_network(network, forms, rung, further.get(rung.name, (rung, None))[1])
        queries = small_queries(small, rung)
        if options.simulate:
            return np.array([Simulation(small).counts(query) for query in queries])
        results = Results(len(queries), small.neurons)
        ask_board(small, queries.__getitem__, len(queries), results, options.batch, options.timeout)
        return results.counts

    bits, signed = int(scalars["bits"]), bool(scalars["signed"])
    forms = formats_of(network)
    further = format_rungs(forms, bits, signed, lateral)
    climbed = rungs(bits, signed, lateral, network.steps) + [rung for rung, _ in further.values()]
    about = {"board": TITLE, "bundle": network.bundle.manifest["sha256"], "simulated": options.simulate}
    about["nxsdk"] = getattr(sys.modules.get("nxsdk"), "__version__", None)
    shape = network.steps, network.silent
    references = {
        "one reference": lambda: self_test(network, fewest(network.bundle.array("host/labels.npy")), options),
        "all references": lambda: self_test(network, 0, options),
    }
    return kept(options.ladder, climb(climbed, ask, shape, references, about))


def check(network: Network, simulate: bool) -> str:
    """Everything but the board."""
    synapses = sum(core.synapses for core in network.cores)
    if simulate:
        Simulation(network)
        return f"ready to simulate: {len(network.cores)} cores, {synapses} synapses, {network.neurons} neurons"
    Device(network).close()
    text = f"ready: {len(network.cores)} cores, {synapses} synapses, {network.neurons} neurons"
    return text if os.environ.get("KAPOHOBAY") == "1" else text + "; set KAPOHOBAY=1 to run on the board"


def main(words: list) -> int:
    """The command line; 0 if all was done."""
    options = parsed(parser("Kapoho Bay"), words)
    if options.simulate and options.power:
        sys.stderr.write("--power needs the board, without --simulate\n")
        return 1
    signal.signal(signal.SIGTERM, interrupt)
    try:
        folder = bundle_of(__file__)
        if options.check:
            print(intact(folder, TARGET), flush=True)
        Results(0, 0, options.out)  # what stands there from an earlier run is gone, whatever happens now
        network = Network(Bundle(folder))
        if options.check:
            print(check(network, options.simulate))
        elif options.ladder:
            print(ladder(network, options))
        elif options.self_test is not None:
            print(self_test(network, options.self_test, options))
        else:
            queries = load_queries(options.queries, network)
            n = len(queries[1])
            results = Results(n, network.neurons, options.out)
            present(network, queries, results, options.batch, options.timeout, options.power, options.simulate)
            print(f"{n} of {n} queries answered")
        return 0
    except Refused as error:
        fail(error.stage, str(error), error.details)
    except KeyboardInterrupt:
        fail("run", "interrupted")
    except OSError as error:
        fail("input", f"{error.filename}: {error.strerror}")
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
