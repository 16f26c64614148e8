"""Pictures as files: headers, pixels, what they mean, and how they are written."""
