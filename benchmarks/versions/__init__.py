"""Encoding, updates and commands of this checkout beside those of another."""
