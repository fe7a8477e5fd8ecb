"""Conditions of probes."""


class SpikeProbeCondition:
    """When a spike probe begins."""

    def __init__(self, dt: int = 1, tStart: int = 1) -> None:
        if not isinstance(tStart, int) or tStart < 1:
            raise ValueError(f"tStart {tStart!r}")
        self.dt, self.tStart = dt, tStart
