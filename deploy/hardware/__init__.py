"""What this project believes about hardware, row by row: value, unit, public source or none, and what breaks."""
