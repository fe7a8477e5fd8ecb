"""All-to-all synapses that learn by STDP."""

PROCESS = "PlasticDense"
