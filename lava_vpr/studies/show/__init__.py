"""What a study found, as JSON, a table, a page and plots."""
