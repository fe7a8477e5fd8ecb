"""Stand-in for the compiler of C Processes."""

from __future__ import annotations

from typing import Any

from lava.magma.compiler.builders.c_builder import CProcessBuilder
from standin_chip.building import BoardCompiler
from standin_chip.checks import StandinError


class CProcCompiler(BoardCompiler):
    """Takes the vendor's own adapters and nothing else."""

    builder = CProcessBuilder

    def check(self, process: Any) -> None:
        """Refuse another Process than an adapter, or one that is not connected to neurons or synapses."""
        if type(process).__name__ not in ("PyToNxAdapter", "NxToPyAdapter"):
            raise StandinError(f"{type(process).__name__} is no adapter of the vendor's")
        if not process.inp.get_src_ports() or not process.out.get_dst_ports():
            raise StandinError(f"{type(process).__name__} is connected on one side only")
