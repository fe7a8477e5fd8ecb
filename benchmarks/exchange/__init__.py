"""Exported networks in other programs, beside the host engine."""
