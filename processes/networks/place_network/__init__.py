"""The whole network of our own Processes."""

PROCESS = "PlaceNetwork"
