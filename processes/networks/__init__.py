"""Hierarchical Processes: whole networks, wired from others."""
