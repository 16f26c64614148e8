"""A tracker."""

from study_app.gaze.source import GazeSample, SourceInfo

RATE_HZ = 120.0
AWAY_FROM_POLL = 15
"""It is asked once a flip: the fixation is over, and the first trial's stimuli are shown."""


class Steady:
    """An eye that looks at one place, ``x,y`` in pixels, and looks away in the first attempt."""

    def __init__(self, rest, desk):
        self.x_px, self.y_px = (float(part) for part in rest.split(","))
        self.clock = desk.clock
        self.attempts = 0
        self.polls = 0

    def open(self):
        self.sent = int(self.clock() * RATE_HZ)

    def info(self):
        return SourceInfo("steady", "a lab's tracker", RATE_HZ)

    def poll(self):
        self.polls += 1
        away = self.attempts == 1 and self.polls > AWAY_FROM_POLL
        before, self.sent = self.sent, int(self.clock() * RATE_HZ)
        stamps = [number / RATE_HZ for number in range(before + 1, self.sent + 1)]
        return [GazeSample(t_s, t_s, self.x_px + 200 * away, self.y_px) for t_s in stamps]

    def mark(self, _text):
        self.attempts += 1
        self.polls = 0

    def calibrate(self, _points_px):
        return None

    def close(self):
        pass
