"""Studies: what one thing after another does to recall and cost, each a row of a registry."""
