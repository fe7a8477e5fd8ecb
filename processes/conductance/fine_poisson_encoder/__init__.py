"""Input spikes of steps of 0.1 ms, from 32-bit draws."""

PROCESS = "FinePoissonEncoder"
