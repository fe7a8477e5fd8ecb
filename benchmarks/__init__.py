"""Benchmarks; each prints what it measures and the command that repeats it."""
