"""The host engine of this checkout beside that of another."""
