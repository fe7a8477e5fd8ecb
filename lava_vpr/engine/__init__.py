"""The host engine: compiled kernels for the integer network, its training, and VPRSNN's conductance model."""
