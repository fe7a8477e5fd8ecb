"""VPRSNN's conductance-based network, composed of Processes."""

PROCESS = "ConductancePlaceNetwork"
