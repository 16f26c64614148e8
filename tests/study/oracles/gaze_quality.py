"""Makes gaze_quality.json with ETDQualitizer (MIT), which is no dependency of ours.

Run: python gaze_quality.py > gaze_quality.json
"""

import json
import warnings

import ETDQualitizer as Qualitizer
import numpy as np

WIDTH_PX, HEIGHT_PX, WIDTH_MM, HEIGHT_MM, DISTANCE_MM = 1920, 1080, 597.6, 336.2, 700.0
# Name, target, samples, SD in pixels, offset in pixels, which samples are lost.
CASES = [
    ("middle", (960, 540), 150, 6, (8, -5), []),
    ("corner", (192, 108), 150, 9, (20, 14), [10, 11, 12, 13, 60]),
    ("far side", (1728, 972), 60, 3, (-70, 40), list(range(20, 40))),
    ("one seen", (960, 108), 5, 2, (1, 1), [0, 1, 3, 4]),
    ("alternate", (960, 972), 11, 4, (0, 30), [1, 3, 5, 7, 9]),
]


def number(value):
    return None if np.isnan(value) else round(float(value), 10)


def main():
    warnings.simplefilter("ignore")
    rng = np.random.default_rng(58)
    screen = Qualitizer.ScreenConfiguration(WIDTH_MM, HEIGHT_MM, WIDTH_PX, HEIGHT_PX, DISTANCE_MM)
    cases = []
    for name, (target_x, target_y), count, sd, offset, lost in CASES:
        x = np.round(target_x + offset[0] + rng.normal(0, sd, count), 2)
        y = np.round(target_y + offset[1] + rng.normal(0, sd, count), 2)
        x[lost] = y[lost] = np.nan
        quality = Qualitizer.DataQuality(
            x - WIDTH_PX / 2, y - HEIGHT_PX / 2, np.arange(count) / 150, "pixels", screen
        )
        target = screen.pix_to_deg(target_x - WIDTH_PX / 2, target_y - HEIGHT_PX / 2)
        cases.append(
            {
                "name": name,
                "target_px": [target_x, target_y],
                "gaze_px": [
                    None if np.isnan(a) else [float(a), float(b)] for a, b in zip(x, y, strict=True)
                ],
                "accuracy_deg": number(quality.accuracy(*target)[0]),
                "rms_s2s_deg": number(quality.precision_RMS_S2S()[0]),
                "std_deg": number(quality.precision_STD()[0]),
                "loss_percent": number(quality.data_loss_from_invalid()),
            }
        )
    screen = {
        "width_px": WIDTH_PX, "height_px": HEIGHT_PX,
        "width_mm": WIDTH_MM, "height_mm": HEIGHT_MM, "distance_mm": DISTANCE_MM,
    }  # fmt: skip
    made = {"made_with": f"ETDQualitizer {Qualitizer.__version__}", "screen": screen}
    text = json.dumps(made | {"cases": cases}, separators=(",", ":"))
    print(text.replace('{"name"', '\n{"name"'))


main()
