"""Our metrics beside NeuroBench's package."""
