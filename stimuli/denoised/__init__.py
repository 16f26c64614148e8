"""Denoising for a gaze: path-traced training pictures, the networks' training, whole files."""
