"""Stand-in for channels between host and embedded processors: shared memory, as between Python models."""

from lava.magma.compiler.channels.pypychannel import PyPyChannel


class CPyChannel(PyPyChannel):
    """From the board."""


class PyCChannel(PyPyChannel):
    """To the board."""
