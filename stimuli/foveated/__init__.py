"""Single pictures for a gaze: read from any file, looked at, laid out, animated."""
