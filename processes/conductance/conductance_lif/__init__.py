"""A population of conductance-based neurons."""

PROCESS = "ConductanceLIF"
