"""The excitatory and the inhibitory population, and relays: leaky integrate-and-fire neurons."""

PROCESSES = (
    "ExcitatoryLIF",
    "InhibitoryLIF",
)
