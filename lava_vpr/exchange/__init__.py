"""Networks in formats that other programs read: written from a model, and read back as one."""
