"""Cache of measurements, by the hash of all that decides the numbers."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from protocols.disk.hashing import Json, sha256_file, sha256_json
from protocols.disk.whole_file import write_whole
from stimuli.score.available import family_versions
from stimuli.score.measured import PairScores
from stimuli.score.metrics import Family
from stimuli.score.pair import ScoredPair
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions


def hash_files(pairs: Iterable[ScoredPair]) -> dict[Path, str]:
    """Return the SHA-256 of every frame and mask."""
    paths = sorted({path for pair in pairs for path in (*pair.test, *pair.truth, *pair.masks)})
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(paths, pool.map(sha256_file, paths), strict=True))


def measurement_key(
    pair: ScoredPair,
    family: Family,
    viewing: ViewingConditions,
    gaze: ViewerGaze,
    hashes: dict[Path, str],
) -> str:
    """Hash frames, masks, the family's version, its packages' versions, and its settings."""
    inputs: dict[str, Json] = {
        "family": family.name,
        "version": family.version,
        "versions": dict(family_versions(family)),
        "fps": pair.fps,
        "test": [hashes[path] for path in pair.test],
        "truth": [hashes[path] for path in pair.truth],
        "masks": [hashes[path] for path in pair.masks],
        "display": viewing.as_json() if family.uses_display else None,
        "gaze": [list(point) for point in gaze.points_px] if family.uses_gaze else None,
    }
    return sha256_json(inputs)


class Cache:
    """A folder of measurements; one that was written is whole."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def read(self, key: str) -> PairScores | None:
        """Return the values under `key`; None if there are none, or they are damaged."""
        if self.folder is None:
            return None
        try:
            raw = json.loads((self.folder / f"{key}.json").read_bytes())
            error_map = None
            if raw["has_map"]:
                data = (self.folder / f"{key}.npy").read_bytes()
                error_map = np.load(io.BytesIO(data), allow_pickle=False)
                if error_map.dtype != np.float32:  # version 0.3 rounded it: measured again
                    return None
            return PairScores(
                {(metric, region): value for metric, region, value in raw["values"]},
                {(metric, region): values for metric, region, values in raw["per_frame"]},
                error_map,
                {
                    name: tuple((float(x), float(y)) for x, y in points)
                    for name, points in raw.get("curves", {}).items()
                },
            )
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def write(self, key: str, measured: PairScores) -> None:
        """Keep `measured`; its numbers are written last."""
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        if measured.error_map is not None:
            buffer = io.BytesIO()
            np.save(buffer, measured.error_map, allow_pickle=False)
            write_whole(self.folder / f"{key}.npy", buffer.getvalue())
        raw = {
            "values": [[*where, value] for where, value in measured.values.items()],
            "per_frame": [[*where, list(found)] for where, found in measured.per_frame.items()],
            "has_map": measured.error_map is not None,
            "curves": {name: [list(p) for p in points] for name, points in measured.curves.items()},
        }
        write_whole(self.folder / f"{key}.json", json.dumps(raw).encode())
