"""Moments of a picture predicted from its noisy path-traced one, and the metamer they make."""
