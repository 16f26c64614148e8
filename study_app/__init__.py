"""Gaze-fixation sessions, and the front door `metamerlab`."""
