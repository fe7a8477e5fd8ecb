"""The paper's table: its printed numbers, and the same computed anew, section by section."""
