"""Where N2Board is before version 1.0."""

from nxsdk_standin.board import N2Board
from nxsdk_standin.faults import FAULTS

if not FAULTS.version.startswith("0."):
    raise ImportError("no module nxsdk.graph.nxboard from version 1.0 on")

__all__ = ["N2Board"]
