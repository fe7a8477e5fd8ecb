"""The inhibitory population."""

PROCESS = "InhibitoryLIF"
