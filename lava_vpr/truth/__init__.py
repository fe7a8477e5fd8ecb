"""Which place each query shows: files of ground truth, positions, traverses in step."""
