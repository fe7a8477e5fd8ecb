"""Stand-in for Intel's NxSDK, for tests."""

from nxsdk_standin.faults import FAULTS

__version__ = FAULTS.version
