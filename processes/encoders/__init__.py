"""Processes that send input spikes: drawn, regular, or from compartments that integrate a bias."""

PROCESSES = (
    "PoissonEncoder",
    "RegularEncoder",
    "FinePoissonEncoder",
    "BiasInputs",
)
