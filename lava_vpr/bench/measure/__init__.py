"""What is measured on this machine or on a board."""
