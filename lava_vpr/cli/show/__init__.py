"""How the commands show answers: as rows of a table, as JSON lines, as a sentence."""
