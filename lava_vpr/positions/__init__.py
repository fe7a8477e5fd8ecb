"""Where and when images were taken: frames of coordinates, and how they are read."""
