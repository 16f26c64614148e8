"""Foveated pictures: metamers of the periphery, and what they are compared with."""
