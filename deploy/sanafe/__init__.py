"""The same figures by SANA-FE, in an environment of its own."""
