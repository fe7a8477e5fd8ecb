"""All-to-all synapses with delays, whose weights stay or follow the spikes of both sides."""

PROCESSES = (
    "DelayedDense",
    "ConductancePlastic",
)
