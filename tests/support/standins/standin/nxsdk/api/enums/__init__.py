"""Where its enumerations are."""
