"""What the host programs of all boards do alike: queries in, counts out, references compared, the ladder climbed."""

import argparse
import contextlib
import json
import os
import signal
import sys
from typing import Any, Dict, FrozenSet, Iterator, List, Sequence, Type

import numpy as np

from bundle_files import Bundle, array_of
from command_line import parsed, parser
from first_look import bundle_of
from gained import under_gains
from ladder import REFERENCES, Attempt, climb, kept, rows_of, say, see_to, versions
from references import (
    check_biases,
    check_pixels,
    check_queries,
    compare,
    compare_pictures,
    fewest,
    first_places,
)
from refusals import Refused, interrupt
from result_files import Results, fail, put
from rungs import Rung, rungs
from ways import OtherWay, chosen

PIXELS = "host/pixels.npy"
BIASES = ("biases", "exponents")
Arrays = Dict[str, np.ndarray]  # rates and keys of queries; biases and exponents, if they have any; or pixels alone


class Host:
    """The network of a bundle, and how its board is asked. Each board has a class of its own, with title and target."""

    title = target = ""
    ways: Sequence[OtherWay] = ()

    def __init__(self, bundle: Bundle, options: argparse.Namespace) -> None:
        self.taken = chosen(options.ways, self.ways)
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

    def ask(self, rung: Any) -> np.ndarray:
        """The counts of a rung's presentations, (presentations, neurons)."""
        raise NotImplementedError

    def further(self) -> List[Any]:
        """The rungs that this board has beside those of every board, of any kind that `ask` takes."""
        return []

    def use(self, ways: FrozenSet[str]) -> None:
        """Do all that follows in these ways."""
        self.taken = ways

    def plain(self) -> List[Rung]:
        """The small networks that every board climbs."""
        names = ("bits", "signed", "steps", "inhibition", "inhibition_exponent")
        bits, signed, steps, size, exponent = self.bundle.numbers(*names)
        return rungs(bits, bool(signed), size << exponent, steps)

    def attempt(self, name: str, ways: FrozenSet[str]) -> dict:
        """Try a rung in some ways; see `ladder.Attempt`."""
        self.use(ways)
        try:
            if name in REFERENCES:
                n = 0
                if name == REFERENCES[0]:
                    n = 1 if self.bundle.direct else fewest(self.bundle.array("host/labels.npy"))
                return {"said": self_test(self, n)}
            rung = next(rung for rung in self.plain() + self.further() if rung.name == name)
            return {"found": np.asarray(self.ask(rung)).tolist()}
        except Refused as error:
            return {"error": str(error), "output": error.output or error.details}

    @contextlib.contextmanager
    def attempts(self) -> Iterator[Attempt]:
        """What tries rungs."""
        yield self.attempt


def load_array(folder: str, name: str) -> np.ndarray:
    """An array of the queries in a folder.

    Raises:
        Refused: it cannot be read.
    """
    path = os.path.join(folder, name + ".npy")
    try:
        with open(path, "rb") as file:
            return np.asarray(array_of(file.read()))
    except OSError as error:
        raise Refused("input", f"{path}: cannot be read ({error.strerror}); write the queries there") from None
    except ValueError:
        raise Refused("input", f"{path}: is no array; write it with numpy.save") from None


def load_queries(bundle: Bundle, folder: str, inputs: int, neurons: int) -> Arrays:
    """The queries in a folder; where it has their activity, under the gains of the bundle's table.

    Raises:
        Refused: they cannot be read, do not fit the network, or are not those of the table.
    """
    if bundle.direct:
        arrays = {name: load_array(folder, name) for name in ("pixels", *_given(folder))}
        check_pixels(arrays["pixels"], bundle.array(PIXELS).shape[1:], folder)
        check_given(arrays, len(arrays["pixels"]), neurons, folder)
        return arrays
    there = [name for name in ("activity", "rates", *BIASES[:1]) if os.path.exists(os.path.join(folder, name + ".npy"))]
    if there[:1] == ["activity"]:
        if len(there) > 1:
            remedy = "leave out activity.npy, or all else"
            raise Refused("input", f"{folder}: has activity.npy, of which gains make {there[1]}.npy, too; {remedy}")
        arrays = under_gains(bundle, load_array(folder, "activity"), folder)
    else:
        arrays = {name: load_array(folder, name) for name in ("rates", "keys", *_given(folder))}
    check_queries(arrays["rates"], arrays["keys"], inputs, folder)
    check_given(arrays, len(arrays["keys"]), neurons, folder)
    return arrays


def _given(folder: str) -> Sequence[str]:
    """The arrays of queries' own biases, if there are any."""
    return BIASES if os.path.exists(os.path.join(folder, BIASES[0] + ".npy")) else ()


def check_given(arrays: Arrays, n: int, neurons: int, folder: str) -> None:
    """Refuse biases of ``n`` queries, if they have any, that are not for this network.

    Raises:
        Refused: they do not fit.
    """
    if BIASES[0] in arrays:
        check_biases(arrays[BIASES[0]], arrays[BIASES[1]], (n, neurons), folder)


def answer(host: Host) -> str:
    """Present the queries of a folder; what was done."""
    arrays = load_queries(host.bundle, host.options.queries, host.inputs, host.neurons)
    n = len(arrays["pixels" if host.bundle.direct else "keys"])
    host.present(arrays, Results(n, host.neurons, host.options.out))
    return f"{n} of {n} queries answered"


def self_test(host: Host, n: int) -> str:
    """Present the first ``n`` references (0: all); what was compared.

    Raises:
        Refused: the counts are not those of the bundle.
    """
    if host.bundle.direct:
        return picture_test(host, n)
    rates, keys, labels, responses = (
        host.bundle.array(f"host/{name}.npy") for name in ("rates", "keys", "labels", "responses")
    )
    check_queries(rates, keys, host.inputs, "host")
    n, places = first_places(labels, n)
    results = Results(n, host.neurons, host.options.out)
    host.present({"rates": rates[:n], "keys": keys[:n]}, results)
    return compare(results.counts, labels[:n], places, responses)


def picture_test(host: Host, n: int) -> str:
    """Present the first ``n`` pictures of places (0: all); what was compared.

    Raises:
        Refused: the counts are not those of the bundle.
    """
    pixels, counts = host.bundle.array(PIXELS), host.bundle.array("host/counts.npy")
    n = min(n, len(pixels)) if n else len(pixels)
    results = Results(n, host.neurons, host.options.out)
    host.present({"pixels": pixels[:n]}, results)
    return compare_pictures(results.counts, counts[:n])


def ladder(host: Host) -> str:
    """Climb the ladder of self-tests, and write the file; what was found.

    Raises:
        Refused: a rung failed, something is missing, or the file cannot be written.
    """
    see_to(host.options.ladder)
    about = {"board": host.title, "bundle": host.bundle.manifest["sha256"], "simulated": host.options.simulate}
    report: Dict[str, Any] = dict(about, versions=versions())
    try:
        report.update(host.require())
    except Refused as error:
        row = {"name": "software", "proves": "what the board needs is here", "passed": False, "error": str(error)}
        say(dict(row, failure="no rung can be tried before"))
        report.update(passed=False, ways=[], rungs=[row])
    else:
        rows = rows_of(host.plain() + host.further(), (host.bundle.numbers("steps")[0], host.silent()))
        with host.attempts() as attempt:
            report.update(climb(rows, attempt, host.ways, host.taken))
    return kept(host.options.ladder, report)


def serve(host: Host) -> None:
    """Make the attempts that are asked for on stdin, a line each: number, rung, ways; answers go into a folder."""
    for line in sys.stdin:
        number, name, ways = json.loads(line)
        put(os.path.join(host.options.attempts, "{}.json".format(number)), host.attempt(name, frozenset(ways)))


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
        host.use(host.taken)
        if options.ladder:
            print(ladder(host))
            return 0
        host.require()
        if options.check:
            print(host.ready())
        elif options.attempts:
            serve(host)
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
