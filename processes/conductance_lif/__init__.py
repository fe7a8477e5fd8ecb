"""A population of conductance-based neurons."""
