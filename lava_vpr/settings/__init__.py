"""Ranges of values, declared by annotations of settings; arguments of public functions; preset ``paper``'s settings."""
