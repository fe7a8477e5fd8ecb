"""The localizer on a robot: drives of every kind, images off the map, milliseconds an image."""
