"""Five kinds of learning side by side, and the search that chose SLAYER's settings."""
