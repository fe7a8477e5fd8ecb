"""From spike counts to places: decoders, sequences, baselines, and the metrics of their answers."""
