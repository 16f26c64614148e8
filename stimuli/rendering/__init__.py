"""Scenes to pictures with depth and motion, and how far a camera must move for a hole."""
