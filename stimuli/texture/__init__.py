"""Textures as statistics, and scenes that read them so: `metamerlab texture`."""
