"""VPRSNN's conductance-based network, preset ``paper``."""
