"""The Processes of VPRSNN's conductance-based network, preset ``paper``."""
