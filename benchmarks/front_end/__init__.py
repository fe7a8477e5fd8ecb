"""The spiking front end: what its forms and numbers do to recall, and what they cost."""
