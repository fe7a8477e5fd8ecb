"""Any network of integer LIF neurons and synapses, step by step: the literal reference of the fast kernels."""
