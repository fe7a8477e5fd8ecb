"""Other simulators of Loihi beside our integers."""
