"""Commands that make models out of models: maps that change, networks in other formats."""
