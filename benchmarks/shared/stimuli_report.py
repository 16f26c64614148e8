"""Findings of `benchmarks.stimuli`, for people, for the docs, and as JSON."""

from __future__ import annotations

import os
import platform
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass

WANTED_OVERHEAD, WANTED_SCALING, WANTED_GROWTH = 1.3, 1.7, 1.05


@dataclass(frozen=True)
class Ratio:
    """The median of the rounds, and their least and greatest."""

    median: float
    least: float
    greatest: float

    @classmethod
    def of(cls, rounds: Sequence[float]) -> Ratio:
        """Sum up the ratios of the rounds."""
        return cls(statistics.median(rounds), min(rounds), max(rounds))

    def __str__(self) -> str:
        return f"{self.median:.2f} ({self.least:.2f} to {self.greatest:.2f})"


@dataclass(frozen=True)
class Speed:
    """One method's frames per second, medians of the rounds.

    `overhead` is a build's wall time over the larger of pipeline and encoding time: 1 is
    perfect overlap.
    """

    method: str
    pipeline_fps: float
    encode_fps: float
    build_fps: float
    overhead: Ratio


@dataclass(frozen=True)
class Findings:
    """All that was measured; `peak_mib` is by the number of frames, n and 2n."""

    renderer: str
    scene: str
    width_px: int
    frames: int
    rounds: int
    speeds: list[Speed]
    two_processes_over_one: Ratio
    peak_mib: dict[int, float]

    @property
    def _where(self) -> str:
        size = f"{self.width_px} x {self.width_px * 3 // 4} px"
        return f"`{self.scene}`, {size}, {self.frames} frames, {self.rounds} rounds"

    @property
    def _memory(self) -> str:
        return ", ".join(f"{mib:.0f} MiB for {n} frames" for n, mib in self.peak_mib.items())

    def text(self) -> str:
        """A table for the terminal, with what was wanted."""
        lines = [
            f"{self.renderer}; {self._where}",
            f"{'method':<12} {'pipeline':>9} {'PNG':>9} {'build':>9}  build / larger of both",
        ]
        for speed in self.speeds:
            verdict = _verdict(speed.overhead.median <= WANTED_OVERHEAD, f"<= {WANTED_OVERHEAD}")
            lines.append(
                f"{speed.method:<12} {speed.pipeline_fps:>5.1f} fps {speed.encode_fps:>5.1f} fps"
                f" {speed.build_fps:>5.1f} fps  {speed.overhead}  {verdict}"
            )
        scaling = self.two_processes_over_one
        verdict = _verdict(scaling.median >= WANTED_SCALING, f">= {WANTED_SCALING}")
        lines.append(f"two processes, one rendering thread each: {scaling} x one  {verdict}")
        once, twice = self.peak_mib.values()
        verdict = _verdict(twice <= WANTED_GROWTH * once, f"at most {WANTED_GROWTH} x")
        lines.append(f"peak memory: {self._memory}  {verdict}")
        return "\n".join(lines)

    def markdown(self) -> str:
        """The part of benchmarks/results/stimuli.md that states numbers."""
        lines = [
            f"On {os.cpu_count()} cores with {self.renderer.split(' (')[0]}: {self._where};"
            " medians, and for ratios the least and the greatest round.",
            "",
            "| method | pipeline | PNG | build | wall time / larger of both |",
            "| --- | --- | --- | --- | --- |",
        ]
        lines += [
            f"| `{speed.method}` | {speed.pipeline_fps:.1f} fps | {speed.encode_fps:.0f} fps"
            f" | {speed.build_fps:.1f} fps | {speed.overhead} |"
            for speed in self.speeds
        ]
        lines += [
            "",
            "Two processes with one rendering thread each made"
            f" {self.two_processes_over_one} times as many frames as one.",
            f"Peak memory after the start of a clip was {self._memory}.",
        ]
        return "\n".join(lines)

    def content(self) -> dict[str, object]:
        """Everything, with what it depends on."""
        from protocols.revision import code_revision

        return {
            "cores": os.cpu_count(),
            "platform": platform.platform(),
            "revision": code_revision(),
            "load_average": os.getloadavg()[0],
            **asdict(self),
        }


def _verdict(holds: bool, wanted: str) -> str:
    return f"[{'holds' if holds else 'MISSED'}: {wanted}]"
