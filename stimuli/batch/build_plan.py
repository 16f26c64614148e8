"""Clips of a study to make, with all that decides their pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.foveation.geometry import Flat, FlatGeometry
from pipeline.methods.registry import check_method_name, method_files, method_parameters
from protocols.disk.hashing import Json, sha256_file, sha256_json
from protocols.display import Display
from protocols.feasibility import clip_size_px
from protocols.manifest import cache_key
from protocols.recipes.warped_clips import ClipName, FillMethod, Scene, Size
from protocols.study_file.schema import StudyProtocol
from stimuli.batch.sources import source_sha256
from stimuli.media.gaze_and_display import width_deg
from stimuli.rendering.open_scene import BASE_MODULES, scene_inputs, scene_modules


@dataclass(frozen=True)
class BuildPlan:
    """A study to build; small, and the same on every machine that reads the same files.

    Parameters
    ----------
    folder : Path
        What file names in the protocol are relative to.
    """

    study: StudyProtocol
    display: Display
    folder: Path

    @cached_property
    def clip_names(self) -> tuple[ClipName, ...]:
        """Every clip, scenes together."""
        shown = set(self.study.shown())
        pool = self.study.warped.pool()
        return tuple(ClipName.of(entry.condition) for entry in pool if entry.name in shown)

    @cached_property
    def _surveys(self) -> dict[tuple[str, str], str]:
        return {}

    @property
    def shown_px(self) -> tuple[int, int]:
        """Width and height of every clip on the display."""
        return clip_size_px(self.study, self.display)

    @property
    def render_px(self) -> tuple[int, int]:
        """Width and height at which frames are made, before they are rescaled."""
        width, height = self.shown_px
        asked = self.study.warped.clips.render_width_px
        return (width, height) if asked is None else (asked, max(1, round(height * asked / width)))

    @property
    def distance_px(self) -> float:
        """Distance of the eye in pixels of frames as they are made."""
        of_display = self.display.distance_mm / self.display.pitch_x_mm
        return of_display * self.render_px[0] / self.shown_px[0]

    @property
    def eye(self) -> FlatGeometry:
        """Frames as they are made, before the eye."""
        return Flat(distance_px=self.distance_px).of(*self.render_px)

    def scene(self, clip: ClipName) -> Scene:
        """The scene of a clip."""
        return self.study.warped.scene(clip.scene)

    def size(self, clip: ClipName) -> Size:
        """The size of a clip."""
        return next(size for size in self.study.warped.sizes if size.name == clip.size)

    def method(self, clip: ClipName) -> FillMethod:
        """The method of a clip."""
        return self.study.warped.method(clip.method)

    def registry_name(self, clip: ClipName) -> str:
        """The method's registry name, with its path in `folder` and the clip's names in it.

        ``{scene}`` and ``{size}`` in the path stand for those of the clip.
        """
        name = self.method(clip).registry_name
        kind, colon, path = name.partition(":")
        for column in ("scene", "size"):
            path = path.replace(f"{{{column}}}", getattr(clip, column))
        return f"{kind}:{self.folder / path}" if colon else name

    def parameters(self, clip: ClipName) -> dict[str, Any]:
        """Every parameter of the clip's method, given, by the display or by default."""
        if self.method(clip).is_reference:
            return {}
        given = self.method(clip).parameters
        found = method_parameters(self.registry_name(clip)) | given
        if found.get("fovea_deg") and "width_deg" in found.keys() - given:
            found["width_deg"] = width_deg(self.eye)
        return found

    def survey_key(self, clip: ClipName) -> str:
        """The hash of all that decides extent, margin and holes of a clip."""
        known, key = self._surveys, (clip.scene, clip.size)
        if key not in known:
            scene, clips = self.scene(clip), self.study.warped.clips
            known[key] = sha256_json(
                {
                    "scene": scene_inputs(scene, self.folder),
                    "sources": source_sha256(*BASE_MODULES, *scene_modules(scene)),
                    "size": self.size(clip).model_dump(
                        mode="json", include={"hole_share", "extent_m"}
                    ),
                    "render_px": list(self.render_px),
                    "frames": clips.frames,
                    "fps": clips.fps,
                    "margin_share": clips.margin_share,
                }
            )
        return known[key]

    def clip_key(self, clip: ClipName) -> str:
        """The manifest's cache key: all that decides a clip's pixels."""
        clips = self.study.warped.clips
        inputs: dict[str, Json] = {
            "survey": self.survey_key(clip),
            "method": self._method_inputs(clip),
            "seed": clips.seed,
            "bit_depth": clips.bit_depth,
            "shown_px": list(self.shown_px),
            "rescale": clips.rescale,
            "exr": clips.exr,
        }
        if clips.true_view is not None:
            inputs["true_view"] = [clips.true_view.model_dump(), self.distance_px]
        if clips.periphery is not None:
            sources = source_sha256("pipeline.foveation.conditions", "pipeline.foveation.energy")
            inputs["periphery"] = [clips.periphery.model_dump(mode="json"), sources]
        return cache_key(inputs)

    def _method_inputs(self, clip: ClipName) -> Json:
        if self.method(clip).is_reference:
            return "reference"
        name = self.registry_name(clip)
        entry = check_method_name(name)
        inputs: dict[str, Json] = {
            "name": entry.name,
            "parameters": self.parameters(clip),
            "sources": source_sha256(entry.target.partition(":")[0]),
        }
        if entry.takes_path:
            path = Path(name.partition(":")[2])
            folder = path if path.is_dir() else path.parent
            inputs["files"] = {
                file.relative_to(folder).as_posix(): sha256_file(file)
                for file in method_files(name)
            }
        return inputs
