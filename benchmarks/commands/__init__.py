"""What a command takes from its start to its end."""
