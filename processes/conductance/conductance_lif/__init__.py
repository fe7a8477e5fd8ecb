"""A population of conductance-based neurons."""

PROCESSES = ("ConductanceLIF",)
