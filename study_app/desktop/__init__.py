"""The window on a desktop: flips and their stamps, keys, pixels, and what may cover it."""
