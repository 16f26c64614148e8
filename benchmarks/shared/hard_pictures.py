"""Pictures on which noise that is clipped fails: print, line art, hues, a pale sky, a night."""

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float32]
Colour = tuple[int, int, int]

WORDS = ["the", "mean", "colour", "of", "a", "page", "of", "print", "is", "nearly", "that", "of",
         "its", "paper", "and", "not", "grey"]  # fmt: skip


def text_page(
    edge: int,
    ink: Colour = (0, 0, 0),
    paper: Colour = (255, 255, 255),
    *,
    line_px: int = 13,
    stroke_px: int = 1,
) -> Picture:
    """A page of print, black on white unless told otherwise."""
    rng, page = np.random.default_rng(1), np.full((edge, edge, 3), paper, np.uint8)
    for line in range(line_px - 1, edge - 4, line_px):
        words = " ".join(rng.choice(WORDS, edge // 30))
        face = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(page, words, (6, line), face, 0.33, ink, stroke_px, cv2.LINE_AA)
    return as_floats(page)


def coloured_lines(edge: int) -> Picture:
    """Lines and discs of saturated colours on yellow."""
    rng, page = np.random.default_rng(2), np.full((edge, edge, 3), (255, 240, 40), np.uint8)
    inks = (230, 20, 20), (20, 20, 220), (0, 130, 0), (0, 0, 0)
    for _ in range(edge // 4):
        (start, end), ink = rng.integers(0, edge, (2, 2)).tolist(), inks[rng.integers(4)]
        filled = -1 if rng.random() < 0.3 else 2
        cv2.line(page, start, end, ink, 2, cv2.LINE_AA)
        cv2.circle(page, start, int(rng.integers(5, 30)), ink, filled, cv2.LINE_AA)
    return as_floats(page)


def hues(edge: int) -> Picture:
    """All hues along x, and their values along y."""
    value, hue = np.mgrid[:edge, :edge] / edge
    hsv = np.stack([360 * hue, np.ones_like(hue), value], axis=2).astype(np.float32)
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), np.float32)


def line_art(edge: int) -> Picture:
    """Black lines and circles on white."""
    rng, page = np.random.default_rng(2), np.full((edge, edge, 3), 255, np.uint8)
    for _ in range(edge // 8):
        start, end = rng.integers(0, edge, (2, 2)).tolist()
        cv2.line(page, start, end, (0, 0, 0), 1, cv2.LINE_AA)
        cv2.circle(page, start, int(rng.integers(5, 30)), (0, 0, 0), 1, cv2.LINE_AA)
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
    return np.asarray(picture, np.float32) / np.float32(255)
