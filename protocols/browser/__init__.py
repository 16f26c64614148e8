"""A study in a browser: what is exported, and the lines that come home."""
