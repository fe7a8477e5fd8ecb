"""Which neuron stands on which core, and the largest map that fits."""
