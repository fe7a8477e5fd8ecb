"""VPRSNN's network of two conductance-based populations, as one hierarchical Process, and its populations."""

PROCESSES = ("ConductanceLIF", "ConductancePlaceNetwork")
