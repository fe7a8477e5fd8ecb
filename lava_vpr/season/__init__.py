"""What was learned of a season, apart from the model, as files: it, and what a drive was presented with."""
