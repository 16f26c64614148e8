"""Denoising for a gaze: path-traced pictures, and whole files."""
