"""From pixels to the activity of input channels."""
