"""Compressed pictures as files, and what they are compared with: `metamerlab compress`."""
