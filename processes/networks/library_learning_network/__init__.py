"""The network that learns places, of nothing but Lava's library."""

PROCESS = "LibraryLearningNetwork"
