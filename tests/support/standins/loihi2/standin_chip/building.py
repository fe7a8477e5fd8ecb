"""What compiler and runtime want of a Process on the board: a subcompiler, a builder, addresses."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from lava.magma.compiler.builders.interfaces import AbstractProcessBuilder
from lava.magma.compiler.subcompilers.address import NcLogicalAddress
from lava.magma.compiler.subcompilers.channel_map_updater import ChannelMapUpdater
from lava.magma.compiler.subcompilers.interfaces import SubCompiler
from lava.magma.compiler.utils import LoihiPortInitializer, VarInitializer
from lava.magma.compiler.var_model import LoihiAddress, LoihiNeuronVarModel


def address() -> list[LoihiAddress]:
    """Somewhere on the only core that there is."""
    return [LoihiAddress(0, 0, 0, 0, 0, 1, 1)]


class BoardBuilder(AbstractProcessBuilder):
    """A Process on the board: its parameters, what it is connected to, and its channels to the host.

    The attributes that are always empty are those that Lava's mapper walks through.
    """

    def __init__(self, process: Any) -> None:
        super().__init__(process.model_class, process.id)
        self.kind, self.process_id, self.params = type(process).__name__, process.id, process.proc_params
        self.variables = [VarInitializer(v.name, v.shape, v.init, v.id) for v in process.vars]
        self.sources = {
            port.name: [(s.process.id, s.name) for s in port.get_src_ports()] for port in process.in_ports.members
        }
        self.shapes = {port.name: port.shape for port in process.in_ports.members + process.out_ports.members}
        self.channels: dict[str, Any] = {}
        self.var_id_to_var_model_map = {v.id: LoihiNeuronVarModel(var=v, address=address()) for v in process.vars}
        self.compiled_resources = [SimpleNamespace(l_address=NcLogicalAddress(0, 0))]
        self.io_ports: dict[str, Any] = {}
        self.var_ports: dict[str, Any] = {}
        self.c_ports: dict[str, Any] = {}
        self.ref_ports: dict[str, Any] = {}

    def map_to_virtual(self, addresses: list[Any]) -> None:
        """There is one core."""

    def set_csp_ports(self, ports: list[Any]) -> None:
        """Remember the channels to and from the host, by port."""
        for port in ports:
            self.channels[port.name] = port

    def add_csp_port_mapping(self, port_id: str, port: Any) -> None:
        """Only virtual ports need it."""

    def build(self) -> None:
        """The runtime service builds the whole chip."""


class BoardCompiler(SubCompiler):
    """Compiles Processes whose models are for the board."""

    builder: type[BoardBuilder] = BoardBuilder

    def check(self, process: Any) -> None:
        """Refuse a Process that does not belong on the board."""

    def compile(self, channel_map: Any, partitioning: Any = None) -> Any:
        """Check each Process and add its connections."""
        updater = ChannelMapUpdater(channel_map)
        for process in self._proc_group:
            self.check(process)
            updater.add_src_ports(process.out_ports)
            updater.add_dst_ports(process.in_ports)
        return updater.channel_map

    def get_builders(self, channel_map: Any) -> tuple[dict[Any, BoardBuilder], Any]:
        """A builder for each Process, and initializers for all ports."""
        size = self._compile_config["pypy_channel_size"]
        for process in self._proc_group:
            for port in process.in_ports.members + process.out_ports.members:
                initializer = LoihiPortInitializer(port.name, port.shape, np.int32, type(port).__name__, size)
                initializer.var_model = LoihiNeuronVarModel(address=address())
                channel_map.set_port_initializer(port, initializer)
        return {process: self.builder(process) for process in self._proc_group}, channel_map
