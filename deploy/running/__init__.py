"""A bundle's host program, run from here."""
