"""Inhibition of all others."""
