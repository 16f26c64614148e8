"""Pictures on which noise that is clipped fails: print, line art, a pale sky, a night."""

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float32]

WORDS = ["the", "mean", "colour", "of", "a", "page", "of", "print", "is", "nearly", "that", "of",
         "its", "paper", "and", "not", "grey"]  # fmt: skip


def text_page(edge: int) -> Picture:
    """Black print on white."""
    rng, page = np.random.default_rng(1), np.full((edge, edge, 3), 255, np.uint8)
    for line in range(12, edge - 4, 13):
        words = " ".join(rng.choice(WORDS, edge // 30))
        cv2.putText(page, words, (6, line), cv2.FONT_HERSHEY_SIMPLEX, 0.33, 0, 1, cv2.LINE_AA)
    return as_floats(page)


def line_art(edge: int) -> Picture:
    """Black lines and circles on white."""
    rng, page = np.random.default_rng(2), np.full((edge, edge, 3), 255, np.uint8)
    for _ in range(edge // 8):
        ends = rng.integers(0, edge, (2, 2)).tolist()
        cv2.line(page, *ends, (0, 0, 0), 1, cv2.LINE_AA)
        cv2.circle(page, ends[0], int(rng.integers(5, 30)), (0, 0, 0), 1, cv2.LINE_AA)
    return as_floats(page)


def pale_sky(edge: int) -> Picture:
    """Clouds up to white before a pale blue."""
    rng, frequency = np.random.default_rng(3), np.fft.fftfreq(edge)
    falling = np.maximum(np.hypot(frequency[:, None], frequency), 1 / edge) ** -1.5
    plane = np.real(np.fft.ifft2(np.fft.fft2(rng.standard_normal((edge, edge))) * falling))
    cloud = 1 / (1 + np.exp(3 - 6 * plane / plane.std()))[..., None]
    sky = np.array([0.8, 0.9, 0.97])
    return np.asarray(sky + cloud * (1 - sky), np.float32)


def night(edge: int) -> Picture:
    """Lamps and stars before a dark sky."""
    rng = np.random.default_rng(4)
    picture = rng.uniform(2, 12, (edge, edge, 1)).repeat(3, axis=2).astype(np.uint8)
    for _ in range(edge // 2):
        place, colour = rng.integers(0, edge, 2).tolist(), rng.uniform(120, 255, 3).tolist()
        cv2.circle(picture, place, int(rng.integers(0, 3)), colour, -1, cv2.LINE_AA)
    return as_floats(picture)


def as_floats(picture: NDArray[np.uint8]) -> Picture:
    """Eight bits in [0, 1]."""
    return picture.astype(np.float32) / 255
