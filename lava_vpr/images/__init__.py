"""Image files as arrays of pixels."""
