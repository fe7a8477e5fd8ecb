"""The folder that holds all that a board gets: written, read, and opened as a network again."""
