"""Experiments: pure tasks from settings and seed to figures, run as a grid, kept by content, searched over."""
