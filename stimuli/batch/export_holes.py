"""Files that another program needs to fill a study's holes: warped frames, masks, depth, names.

A folder for each scene and size. Its extent, margin and masks are those of a build.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.gl.context import lent_context
from pipeline.pictures.write import write_pixels
from protocols.disk.result_folder import whole_folder
from protocols.disk.whole_file import write_whole
from protocols.outside import page_bytes
from stimuli.batch.batch_folder import survey_name
from stimuli.batch.build_plan import BuildPlan
from stimuli.batch.clip import shot_of, take_survey
from stimuli.batch.footage import Footage
from stimuli.media.png import encode_frame
from stimuli.rendering.open_scene import open_scenery

NAMES_FILE = "frames.csv"
README_FILE = "README.md"
COLUMNS = ("scene", "size", "frame", "warped", "mask", "depth", "send_back")

_README = Path(__file__).with_name("holes_readme.md")


def export_holes(plan: BuildPlan, out: Path, report: Callable[[int, int, str], None]) -> int:
    """Write every warped frame of a study with its mask and depth; return how many frames.

    Parameters
    ----------
    plan : BuildPlan
        The study; methods that are not here yet do not matter.
    out : Path
        A new or empty folder.
    report : callable
        Called with frames done, frames in all, and what is going on.

    Raises
    ------
    StudyError, InputError, OSError
        If `out` is not empty, or a scene cannot be opened; nothing is written then.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: must be a new or empty folder (something is in it)")
    kinds = list({survey_name(clip): clip for clip in plan.clip_names}.values())
    clips = plan.study.warped.clips
    total, done = len(kinds) * clips.frames, 0
    names = io.StringIO()
    table = csv.writer(names, lineterminator="\n")
    table.writerow(COLUMNS)
    with whole_folder(out) as work, lent_context() as ctx:
        for clip in kinds:
            report(done, total, f"{clip.scene}, {clip.size}: finding the path")
            scenery = open_scenery(ctx, plan.scene(clip), plan.folder)
            place = Path(clip.scene) / clip.size
            survey = take_survey(ctx, scenery, plan, clip, work / place / "mask")
            shot = shot_of(plan, clip, survey.extent_m)
            footage = Footage(ctx, scenery, shot, margin_px=survey.margin_px)
            for part in ("warped", "depth"):
                (work / place / part).mkdir()
            for frame in range(clips.frames):
                warped = footage.warped(frame)
                colour = np.where(warped.hole[..., None], np.float32(0), warped.colour)
                names_of = (
                    place / "warped" / f"{frame:06d}.png",
                    place / "mask" / f"{frame:06d}.png",
                    place / "depth" / f"{frame:06d}.exr",
                )
                write_whole(work / names_of[0], encode_frame(colour, clips.bit_depth))
                write_pixels(
                    work / names_of[2], warped.depth_m[..., None], ("Z",), types=("float",)
                )
                send_back = Path("filled") / place / f"{frame:06d}.png"
                paths = (path.as_posix() for path in (*names_of, send_back))
                table.writerow((clip.scene, clip.size, frame, *paths))
                done += 1
                report(done, total, f"{clip.scene}, {clip.size}")
            footage.release()
            scenery.release()
        write_whole(work / NAMES_FILE, names.getvalue().encode())
        width, height = plan.render_px
        readme = _README.read_text(encoding="utf-8").format(
            clips=len(kinds), frames=clips.frames, width=width, height=height, bits=clips.bit_depth,
            study=plan.study.study.name,
        )  # fmt: skip
        write_whole(work / README_FILE, page_bytes(readme))
    return total
