"""All-to-all synapses, each with a delay of its own."""

PROCESS = "DelayedDense"
