"""Small Lava Processes that fail on demand. Lava executes every file of a Process's folder: keep other things out."""
