"""Forward warp with background depth in disocclusions (Kuffner dos Anjos et al. 2022, 3.1)."""
