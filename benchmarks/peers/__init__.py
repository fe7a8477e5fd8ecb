"""Other place recognition systems beside ours."""
