"""The whole network as one fast Process."""

PROCESS = "FusedPlaceNetwork"
