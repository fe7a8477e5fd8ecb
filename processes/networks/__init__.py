"""Hierarchical Processes: whole networks, wired from others, and one that is a single fast Process."""

PROCESSES = ("PlaceNetwork", "FusedPlaceNetwork", "LearningPlaceNetwork")
