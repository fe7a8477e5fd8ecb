"""What a host program does before it imports numpy: without it, files are checked all the same.

This needs nothing but Python.
"""

import importlib.util
import os
import sys

from bundle_files import Bundle
from refusals import Refused


def look(program: str, target: str, words: list) -> None:
    """End this process if numpy is missing; with ``--check``, after the files of the bundle around ``program`` are seen
    to be intact."""
    if importlib.util.find_spec("numpy") is not None:
        return
    if "--check" in words:
        try:
            print(Bundle(bundle_of(program), target).intact())
        except Refused as error:
            sys.exit(str(error))
    sys.exit("{} has no numpy; install it for this Python: pip install numpy".format(sys.executable))


def bundle_of(program: str) -> str:
    """The folder of the bundle that a program stands in."""
    return os.path.dirname(os.path.dirname(os.path.abspath(program)))
