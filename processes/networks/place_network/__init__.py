"""The whole network of our own Processes."""

PROCESSES = ("PlaceNetwork",)
