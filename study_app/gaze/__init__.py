"""Gaze: where it comes from, what it means in degrees, and when fixation counts as held."""
