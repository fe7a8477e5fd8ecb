"""The benchmark datasets of the field: where they keep their images, and which of them the paper uses."""
