"""The golden files: what commands and calls give, byte for byte, compared with a committed record."""
