"""Noise of known band statistics, for fills and for foveated pictures."""
