"""Files in and out: what is read may be an enemy's, what is written replaces nothing by half."""
