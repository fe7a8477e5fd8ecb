"""Input compartments that integrate a bias."""

PROCESS = "BiasInputs"
