"""Regular input spikes, made by the host."""

PROCESS = "RegularEncoder"
