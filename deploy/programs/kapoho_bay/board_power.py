"""Power and time of a run as NxSDK measures them.

The probe is that of public programs for Nahuku, the board of Intel's cluster. The names of the figures are unproven,
and whether Kapoho Bay has the sensors is not public. If NxSDK has nothing to tell, that is said.
"""

import math
from typing import Any

from refusals import Refused, told

BUFFER = 1024  # bins, each of a power of two of steps


def attach(board: Any, steps: int) -> None:
    """Let NxSDK measure the next ``steps`` steps; before the board starts.

    Raises:
        Refused: it cannot.
    """
    try:
        from nxsdk.api.enums.api_enums import ProbeParameter  # type: ignore[import-not-found]
        from nxsdk.graph.monitor.probes import PerformanceProbeCondition  # type: ignore[import-not-found]

        width = 1 << max(0, math.ceil(math.log2(steps / BUFFER)))
        condition = PerformanceProbeCondition(tStart=1, tEnd=steps, bufferSize=BUFFER, binSize=width)
        board.probe(probeType=ProbeParameter.ENERGY, probeCondition=condition)
    except Exception as error:
        raise Refused("missing", f"NxSDK cannot measure power here ({told(error)}); leave out --power") from None


def figures(board: Any, steps: int) -> dict:
    """What was measured; after the board is let go.

    Raises:
        Refused: nothing.
    """
    try:
        stats = board.energyTimeMonitor.powerProfileStats
        found = {"microseconds_per_step": float(stats.timePerTimestep)}
        for name, key in (("milliwatts", "total"), ("idle_milliwatts", "idle"), ("dynamic_milliwatts", "dynamic")):
            found[name] = float(stats.power[key])
    except Exception as error:
        raise Refused("run", f"NxSDK measured no power ({told(error)}); the board may have no sensors") from None
    if not (found["microseconds_per_step"] > 0 and 0 < found["milliwatts"] < math.inf):
        raise Refused("run", f"NxSDK measured no power ({found}); the board may have no sensors")
    found["steps"] = float(steps)
    return found
