"""Records of a batch's clips: which are there whole, and what the manifest says of each."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

from protocols.disk.hashing import sha256_file
from protocols.disk.whole_file import write_whole
from protocols.display import Display
from protocols.errors import StudyError
from protocols.manifest import Clip, Manifest, read_manifest
from protocols.manifest import Renderer as RendererEntry
from protocols.recipes.warped_clips import BuiltinScene, ClipName, MeshScene
from protocols.revision import code_revision, package_version
from protocols.study_file.schema import StudyProtocol
from protocols.units import Scalar
from stimuli.batch.batch_folder import BUILD_FOLDER, HOLES_FOLDER, survey_name
from stimuli.batch.build_plan import BuildPlan
from stimuli.batch.clip import Survey, read_survey
from stimuli.rendering.open_scene import open_world
from stimuli.worker import RendererInfo

VERSIONED = (
    "moderngl", "numpy", "scipy", "scikit-image", "opencv-python-headless", "OpenImageIO",
    "pillow",
)  # fmt: skip


class ManifestDraft:
    """The manifest's entries in the making, for one renderer: bytes repeat on one only."""

    def __init__(
        self, study: StudyProtocol, display: Display, out: Path, renderer: RendererInfo
    ) -> None:
        self._study, self._display = study, display
        self._out, self._renderer = out, renderer
        self._folder = out / BUILD_FOLDER / "records"

    def old(self) -> dict[str, Clip]:
        """Return the clips of an earlier build of this renderer, by name."""
        records: dict[str, Clip] = {}
        try:
            manifest = read_manifest(self._out)
            old = manifest.renderer
            if RendererInfo(old.vendor, old.renderer, old.version) == self._renderer:
                records = {clip.name: clip for clip in manifest.clips}
        except StudyError:
            pass
        for path in self._folder.glob("*.json"):
            try:
                raw = json.loads(path.read_bytes())
                clip = Clip.model_validate_json(json.dumps(raw["clip"]))
            except (ValueError, KeyError, TypeError, RecursionError):
                continue
            if raw["renderer"] == asdict(self._renderer):
                records[clip.name] = clip
        return records

    def is_stale(self, clips: Iterable[Clip]) -> bool:
        """True if the folder has no manifest, or one that says other things than `clips`."""
        # Not for the revision: it says who made the clips, and sessions cite the manifest's hash.
        made_by = {"revision": "", "versions": {}}
        try:
            old = read_manifest(self._out).model_copy(update=made_by)
        except StudyError:
            return True
        return old != self.manifest(clips).model_copy(update=made_by)

    def check_renderer(self, renderer: RendererInfo) -> None:
        """Require that a worker draws with the batch's renderer.

        Raises
        ------
        StudyError
            Naming both.
        """
        if renderer != self._renderer:
            raise StudyError(
                "all workers must draw with one renderer, or their clips are not comparable"
                f" (found {self._renderer.renderer} {self._renderer.version} and"
                f" {renderer.renderer} {renderer.version}); leave the odd machine out"
            )

    def store(self, record: Clip) -> None:
        """Keep a clip's entry until the manifest is written."""
        self._folder.mkdir(parents=True, exist_ok=True)
        content = {"clip": record.model_dump(mode="json"), "renderer": asdict(self._renderer)}
        write_whole(
            self._folder / f"{record.name}.json", json.dumps(content, sort_keys=True).encode()
        )

    def manifest(self, clips: Iterable[Clip]) -> Manifest:
        """Return the manifest of `clips`, which come in the order of the study."""
        return Manifest(
            format=2,
            study=self._study.study.name,
            stimuli_sha256=self._study.stimuli_sha256,
            display=self._display.name,
            revision=f"{package_version()}, revision {code_revision()}",
            renderer=RendererEntry(**asdict(self._renderer)),
            versions=pixel_versions(),
            clips=tuple(clips),
        )


def is_whole(folder: Path, record: Clip, endings: Sequence[str] = (".png",)) -> bool:
    """True if `folder` holds the frames of `record`, unchanged, and nothing else."""
    frames = range(len(record.frames_sha256))
    wanted = {f"{index:06d}{ending}" for index in frames for ending in endings}
    try:
        if {entry.name for entry in folder.iterdir()} != wanted:
            return False
        return all(
            sha256_file(folder / f"{index:06d}.png") == sha
            for index, sha in enumerate(record.frames_sha256)
        )
    except OSError:
        return False


class WarpedDraft(ManifestDraft):
    """The draft of a batch of warped clips."""

    def __init__(self, plan: BuildPlan, out: Path, renderer: RendererInfo) -> None:
        super().__init__(plan.study, plan.display, out, renderer)
        self._orders = plan
        self._noted: dict[str, str] = {}  # of mesh scenes, by name

    def _notes(self, scene: MeshScene) -> str:
        """Statements of a mesh that are not drawn, without the folder that it lies in."""
        if scene.name not in self._noted:
            folder = self._orders.folder
            notes = "; ".join(open_world(scene, folder).notes)
            self._noted[scene.name] = notes.replace(f"{folder}/", "")
        return self._noted[scene.name]

    def is_done(self, name: ClipName, record: Clip | None) -> bool:
        """True if `name` is there whole, made from what is wanted now."""
        if record is None or record.cache_key != self._orders.clip_key(name):
            return False
        masks = self._out / HOLES_FOLDER / survey_name(name)
        if read_survey(masks, self._orders.survey_key(name)) is None:
            return False
        exr = self._orders.study.warped.clips.exr
        return is_whole(self._out / str(name), record, (".png", ".exr") if exr else (".png",))

    def record(self, name: ClipName, survey: Survey, hashes: list[str]) -> Clip:
        """Return the manifest's entry of a clip with these frames."""
        plan = self._orders
        scene, clips, (width, height) = (
            plan.scene(name),
            plan.study.warped.clips,
            plan.shown_px,
        )
        parameters: dict[str, Scalar | tuple[Scalar, ...]] = {
            "path": scene.camera.kind,
            "extent_m": survey.extent_m,
            "margin_px": survey.margin_px,
            "hole_share_least": survey.hole_share_least,
            "hole_share_most": survey.hole_share_most,
            "hole_masks_sha256": survey.masks_hash,
            "scene_seed": scene.seed,
            "method": plan.method(name).registry_name,
            "exr": clips.exr,
            "preview": clips.preview,
        }
        if not isinstance(scene, (BuiltinScene, MeshScene)):
            parameters["rim_px"] = scene.rim_px
            parameters["depth_speckle"] = scene.depth_speckle
        if isinstance(scene, MeshScene) and (notes := self._notes(scene)):
            parameters["noted"] = notes
        parameters |= clips.around_dot()
        if clips.true_view is not None:
            share = width / plan.render_px[0]
            x_px, y_px = plan.eye.place_px(clips.true_view.x_deg, clips.true_view.y_deg)
            parameters |= {
                "gaze_x_px": x_px * share, "gaze_y_px": y_px * share,
                "distance_px": plan.distance_px * share,
            }  # fmt: skip
        for key, value in plan.parameters(name).items():
            if value is not None:
                parameters[f"method.{key}"] = tuple(value) if isinstance(value, list) else value
        return Clip(
            name=str(name),
            condition=dict(name.condition),
            width_px=width,
            height_px=height,
            fps=clips.fps,
            bit_depth=clips.bit_depth,
            seed=clips.seed,
            parameters=parameters,
            hole_share=survey.hole_share,
            cache_key=plan.clip_key(name),
            frames_sha256=tuple(hashes),
        )


def pixel_versions() -> dict[str, str]:
    """Return Python's version and those of the packages that take part in making pixels."""
    found = {"python": platform.python_version()}
    for package in VERSIONED:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found
