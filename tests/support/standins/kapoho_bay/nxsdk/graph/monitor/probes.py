"""Conditions of probes."""


class PerformanceProbeCondition:
    """Which steps are measured, and how many make a value."""

    def __init__(self, tStart: int, tEnd: int, bufferSize: int, binSize: int) -> None:
        if tStart != 1 or tEnd < 1 or binSize & (binSize - 1) or binSize * bufferSize < tEnd:
            raise ValueError(f"{tStart}..{tEnd} in {bufferSize} bins of {binSize} steps")
        self.tEnd = tEnd
