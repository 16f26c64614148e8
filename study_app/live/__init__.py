"""Pictures that follow the gaze: the loop, its latency, and its log, which can be drawn again."""
