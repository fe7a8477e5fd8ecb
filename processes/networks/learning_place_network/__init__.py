"""The network that learns places, of our own Processes."""

PROCESS = "LearningPlaceNetwork"
