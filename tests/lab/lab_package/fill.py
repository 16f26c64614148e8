"""A fill method."""

import numpy as np

from pipeline.methods.method import composite


class MeanFill:
    """Fills with the mean of what is known, times a factor."""

    def __init__(self, *, factor: float = 1.0) -> None:
        self.factor = factor

    def fill(self, warped, seed):  # noqa: ARG002
        mean = warped.colour[~warped.hole].mean(axis=0) * np.float32(self.factor)
        return composite(warped, np.broadcast_to(mean, warped.colour.shape))

    def release(self):
        pass


class SettlingFill(MeanFill):
    """The same with a plate as it was once: it completed a finished fill."""

    def new_plate(self):
        return SettlingPlate()


class SettlingPlate:
    def settle(self, warped, filled):  # noqa: ARG002
        return filled
