"""What a second picture saw goes into the holes that the first one left."""
