"""What the host programs of all boards do alike: queries in, counts out, references compared, the ladder climbed."""

import argparse
import os
import signal
from typing import Any, Dict, List, Type

import numpy as np

from bundle_files import Bundle, array_of
from command_line import parsed, parser
from first_look import bundle_of
from ladder import climb, kept, see_to
from references import check_biases, check_queries, compare, fewest, first_places
from refusals import Refused, interrupt
from result_files import Results, fail
from rungs import Rung, rungs

Arrays = Dict[str, np.ndarray]  # rates and keys of queries; biases and exponents, if they have any


class Host:
    """The network of a bundle, and how its board is asked. Each board has a class of its own, with title and target."""

    title = target = ""

    def __init__(self, bundle: Bundle, options: argparse.Namespace) -> None:
        self.bundle, self.options = bundle, options
        self.inputs, self.neurons = bundle.numbers("inputs", "neurons")
        if options.power and options.simulate:
            raise Refused("input", "--power needs the board, without --simulate")

    def require(self) -> Dict[str, Any]:
        """See that what the board needs is here; what was found, by name.

        Raises:
            Refused: something is missing.
        """
        raise NotImplementedError

    def ready(self) -> str:
        """See to everything but the board; what was found."""
        raise NotImplementedError

    def present(self, arrays: Arrays, results: Results) -> None:
        """Present all queries, and keep what is answered.

        Raises:
            Refused: some are not answered.
        """
        raise NotImplementedError

    def silent(self) -> int:
        """Steps without input at the end of a presentation."""
        raise NotImplementedError

    def ask(self, rung: Rung) -> np.ndarray:
        """The counts of a rung's presentations, (presentations, neurons)."""
        raise NotImplementedError

    def further(self) -> List[Rung]:
        """The rungs that this board has beside those of every board."""
        return []


def load_queries(folder: str, inputs: int, neurons: int) -> Arrays:
    """The queries in a folder.

    Raises:
        Refused: they cannot be read or do not fit the network.
    """
    arrays = {}
    biased = os.path.exists(os.path.join(folder, "biases.npy"))
    for name in ("rates", "keys", "biases", "exponents")[: 4 if biased else 2]:
        path = os.path.join(folder, name + ".npy")
        try:
            with open(path, "rb") as file:
                arrays[name] = array_of(file.read())
        except OSError as error:
            raise Refused("input", f"{path}: cannot be read ({error.strerror}); write the queries there") from None
        except (ValueError, EOFError):
            raise Refused("input", f"{path}: is no array; write it with numpy.save") from None
    check_queries(arrays["rates"], arrays["keys"], inputs, folder)
    if biased:
        check_biases(arrays["biases"], arrays["exponents"], (len(arrays["keys"]), neurons), folder)
    return arrays


def answer(host: Host) -> str:
    """Present the queries of a folder; what was done."""
    arrays = load_queries(host.options.queries, host.inputs, host.neurons)
    n = len(arrays["keys"])
    host.present(arrays, Results(n, host.neurons, host.options.out))
    return f"{n} of {n} queries answered"


def self_test(host: Host, n: int) -> str:
    """Present the first ``n`` references (0: all); what was compared.

    Raises:
        Refused: the counts are not those of the bundle.
    """
    rates, keys, labels, responses = (
        host.bundle.array(f"host/{name}.npy") for name in ("rates", "keys", "labels", "responses")
    )
    check_queries(rates, keys, host.inputs, "host")
    n, places = first_places(labels, n)
    results = Results(n, host.neurons, host.options.out)
    host.present({"rates": rates[:n], "keys": keys[:n]}, results)
    return compare(results.counts, labels[:n], places, responses)


def ladder(host: Host, found: Dict[str, Any]) -> str:
    """Climb the ladder of self-tests, and write the file; what was found.

    Raises:
        Refused: a rung failed, or the file cannot be written.
    """
    see_to(host.options.ladder)
    bits, signed, steps, size, exponent = host.bundle.numbers(
        "bits", "signed", "steps", "inhibition", "inhibition_exponent"
    )
    climbed = rungs(bits, bool(signed), size << exponent, steps) + host.further()
    references = {
        "one reference": lambda: self_test(host, fewest(host.bundle.array("host/labels.npy"))),
        "all references": lambda: self_test(host, 0),
    }
    about = {"board": host.title, "bundle": host.bundle.manifest["sha256"], "simulated": host.options.simulate}
    report = climb(climbed, host.ask, (steps, host.silent()), references, dict(about, **found))
    return kept(host.options.ladder, report)


def main(kind: Type[Host], program: str, words: list) -> int:
    """Do what the command line of a host program says, with the bundle that it stands in; the exit code."""
    options = parsed(parser(kind.title), words)
    signal.signal(signal.SIGTERM, interrupt)
    try:
        Results(0, 0, options.out)  # what stands there from an earlier run is gone, whatever happens now
        bundle = Bundle(bundle_of(program), kind.target)
        if options.check:
            print(bundle.intact(), flush=True)
        host = kind(bundle, options)
        found = host.require()
        if options.check:
            print(host.ready())
        elif options.ladder:
            print(ladder(host, found))
        else:
            print(answer(host) if options.queries is not None else self_test(host, options.self_test))
        return 0
    except Refused as error:
        fail(error.stage, str(error), error.details)
    except KeyboardInterrupt:
        fail("run", "interrupted")
    except OSError as error:
        fail("input", f"{error.filename}: {error.strerror}")
    return 1
