"""What others can cite: the benchmark datasets of the field, and the paper's table computed again."""
