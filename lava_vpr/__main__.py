"""The program ``lava-vpr``, also as ``python -m lava_vpr``: minds signals and mends streams before anything else."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from lava_vpr import interrupts

STREAMS = (("stdin", "r"), ("stdout", "w"), ("stderr", "w"))


def run() -> None:
    """Run the command that the arguments name, and exit."""
    interrupts.install()
    mend_streams()
    code: object = 1
    try:
        from lava_vpr.cli import main

        main(prog_name="lava-vpr")
    except SystemExit as ending:
        code = ending.code
    except KeyboardInterrupt:  # a second one, while the first was being told
        pass
    finally:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
        interrupts.finish()
    if isinstance(code, int) and not interrupts.begun():
        os._exit(code)  # a library that was loaded by half, for want of memory, may wait for ever in its own ending
    sys.exit(code)  # type: ignore[arg-type]


def mend_streams() -> None:
    """Open streams that are closed on nothing, so that no file of ours takes their place; let any text be printed.

    What the encoding of a stream lacks is printed as its escape, and so are the bytes of file names that are no text.
    """
    for number, (name, mode) in enumerate(STREAMS):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free, which is this one
        if getattr(sys, name) is None:
            stream = open(number, mode, encoding="utf-8", closefd=False)
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)
    for output in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):
            output.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]


if __name__ == "__main__":
    run()
