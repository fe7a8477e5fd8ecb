"""The paper's table as JSON, CSV, tables, a Markdown page and an HTML page."""
