"""Scenes to pictures with depth and motion: camera paths, renderer, views to look at."""
