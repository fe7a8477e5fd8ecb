"""What excitatory neurons are, and what runs them."""
