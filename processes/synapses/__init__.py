"""Synapses that do not learn: from every input to every neuron, to the partner, or to all others."""

PROCESSES = (
    "DenseSynapses",
    "OneToOne",
    "LateralInhibition",
)
