"""VPRSNN's conductance-based network, composed of Processes."""

PROCESSES = ("ConductancePlaceNetwork",)
