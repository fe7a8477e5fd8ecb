"""One synapse from each neuron to its partner."""

PROCESS = "OneToOne"
