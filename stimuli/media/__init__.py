"""Files and views that the applications share: frames, videos, gaze and display."""
