"""What sends input spikes: drawn, regular, or of compartments that integrate a bias."""

PROCESSES = (
    "PoissonEncoder",
    "RegularEncoder",
    "FinePoissonEncoder",
    "BiasInputs",
)
