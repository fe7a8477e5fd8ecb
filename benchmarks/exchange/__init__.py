"""Exported networks in other programs, each in an environment of its own, beside the host engine."""
