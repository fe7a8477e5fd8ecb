"""The excitatory population."""
