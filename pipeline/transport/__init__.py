"""Coherence transport guided by depth: edges of the background go on in its holes."""
