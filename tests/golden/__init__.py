"""The golden files: what commands and calls give, byte for byte, held against a committed record."""
