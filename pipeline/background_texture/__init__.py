"""Texture of the background itself, where a fill takes it in place of noise."""
