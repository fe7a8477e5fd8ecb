"""The whole network of Lava library Processes."""

PROCESS = "LibraryPlaceNetwork"
