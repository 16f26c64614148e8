"""Denoising for a gaze, of path-traced pictures and whole files: `metamerlab denoise`."""
