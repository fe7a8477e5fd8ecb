"""The paper's table: its printed numbers, and the same computed again, section by section."""
