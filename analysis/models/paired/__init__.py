"""Models of paired comparisons below the scales."""
