"""Stand-in for the compiler of Processes on neuron cores."""

from __future__ import annotations

from typing import Any

from lava.magma.compiler.builders.nc_builder import NcProcessBuilder
from standin_chip.building import BoardCompiler
from standin_chip.checks import check_process


class NcProcCompiler(BoardCompiler):
    """Takes Lava's library Processes whose parameters the chip can hold."""

    builder = NcProcessBuilder

    def check(self, process: Any) -> None:
        """See `standin_chip.checks`."""
        check_process(process)
