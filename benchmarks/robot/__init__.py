"""What a robot would see of the localizer: drives of every sort, knowing when not to know, milliseconds an image."""
