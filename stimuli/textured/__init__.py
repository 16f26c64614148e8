"""Scenes whose surfaces are read as statistics: a planet, spheres, and how many bytes they touch."""
