"""Pictures compressed for a gaze: colour in polar cells, and maps of what those lost."""
