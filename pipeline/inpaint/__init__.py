"""Depth-guided pull and push: fill what the background shows, never the foreground."""
