"""A model in fewer bits, the folder that holds all that a board gets, and its host program, run from here."""
