"""The whole network of Lava library Processes."""
