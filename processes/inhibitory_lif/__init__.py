"""The inhibitory population."""
