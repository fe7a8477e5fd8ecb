"""All-to-all synapses that learn by STDP."""

PROCESSES = ("PlasticDense",)
