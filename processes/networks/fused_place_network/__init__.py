"""The whole network as one fast Process."""

PROCESSES = ("FusedPlaceNetwork",)
