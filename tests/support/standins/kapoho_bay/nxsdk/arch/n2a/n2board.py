"""Where N2Board is from version 1.0 on."""

from nxsdk_standin.board import N2Board
from nxsdk_standin.faults import FAULTS

if FAULTS.version.startswith("0."):
    raise ImportError("no module nxsdk.arch.n2a.n2board before version 1.0")

__all__ = ["N2Board"]
