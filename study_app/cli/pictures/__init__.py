"""Commands on single pictures and clips."""
