"""The command line of every host program."""

import argparse
import os


def parser(board: str) -> argparse.ArgumentParser:
    """What reads the options that every host program takes."""
    own = argparse.ArgumentParser(description=f"Run this bundle on {board}.")
    what = own.add_mutually_exclusive_group(required=True)
    what.add_argument("--check", action="store_true", help="everything but the board")
    what.add_argument("--self-test", nargs="?", type=int, const=0, metavar="N", help="present the (first N) references")
    what.add_argument("--ladder", metavar="FILE", help="all self-tests, smallest first; write one file to send back")
    what.add_argument("--queries", metavar="DIR", help="folder with rates.npy and keys.npy, or activity.npy")
    what.add_argument("--attempts", help=argparse.SUPPRESS)  # the ladder's own child: tries rungs, into this folder
    ways = os.environ.get("LAVA_VPR_WAYS", "")
    own.add_argument(
        "--ways", metavar="W,W", default=ways, help="other ways to ask the board, as --ladder says (LAVA_VPR_WAYS)"
    )
    own.add_argument("--simulate", action="store_true", help="without a board")
    own.add_argument("--out", metavar="DIR", default="", help="folder for counts.npy, done.npy and status.json")
    own.add_argument("--batch", type=int, default=16, metavar="N", help="queries in one run of the board (16)")
    own.add_argument(
        "--timeout", type=float, default=0.0, metavar="S", help="seconds that one run may take (by its size)"
    )
    own.add_argument(
        "--power",
        metavar="FILE",
        default="",
        help="measure power too, all queries in one run; into this file (JSON)",
    )
    return own


def parsed(own: argparse.ArgumentParser, words: list) -> argparse.Namespace:
    """The values of the options."""
    options = own.parse_args(words)
    if options.queries is not None and not options.out:
        own.error("--queries needs --out")
    if options.power and options.queries is None:
        own.error("--power needs --queries")
    if options.batch < 1 or options.timeout < 0 or (options.self_test or 0) < 0:
        own.error("--batch, --timeout and N must be positive")
    return options
