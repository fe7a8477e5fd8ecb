"""The search for cheaper settings."""
