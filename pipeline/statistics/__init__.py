"""Band statistics of the background, carried into the holes, and what a fill lacks of them."""
