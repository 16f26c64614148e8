"""Textures that are read as statistics: baked moments, noise on the surface, bytes touched."""
