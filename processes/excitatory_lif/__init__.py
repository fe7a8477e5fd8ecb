"""The excitatory population."""

PROCESS = "ExcitatoryLIF"
