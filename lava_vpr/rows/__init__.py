"""Registries: one table for each kind of thing that can be added, by this package or by another."""
