"""Event cameras: recordings read block by block, noise taken out, and windows of events turned into images."""
