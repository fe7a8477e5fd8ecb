"""The results of a benchmark as JSON, terminal tables, a page and plots."""
