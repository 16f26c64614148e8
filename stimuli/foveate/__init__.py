"""Pictures and clips for a gaze, from file to file: `metamerlab foveate`."""
