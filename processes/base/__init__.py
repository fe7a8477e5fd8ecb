"""What several Processes share: neurons, checked arrays, learning rules, wiring."""
