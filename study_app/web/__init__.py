"""Studies in a browser: the folder that a page runs, and the lines that come home from it."""
