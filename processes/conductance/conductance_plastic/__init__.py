"""Delayed synapses that learn by the rules of the conductance-based network."""

PROCESS = "ConductancePlastic"
