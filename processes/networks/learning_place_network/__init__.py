"""The network that learns places, of our own Processes."""

PROCESSES = ("LearningPlaceNetwork",)
