"""Any network of integer LIF neurons and synapses, step by step: the literal model of the fast kernels."""
