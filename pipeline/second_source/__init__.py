"""Colours of a second picture in the holes that the first one left."""
