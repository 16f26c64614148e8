"""What the files of a study of warped clips show before anything is built.

Files that are not there are no mistake here: where sittings run, built clips are enough.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from pipeline.errors import InputError
from pipeline.image_file import stated_size_px
from protocols.errors import Problem
from protocols.recipes.warped_clips import ExrScene, StereoScene
from stimuli.exr_parts import frame_files
from stimuli.orders import Orders
from stimuli.scenes.pair_check import judge_pair
from stimuli.scenes.photo import is_built_in, read_pair
from stimuli.scenes.sequence import too_small


@dataclass(frozen=True)
class Findings:
    """What must change, and what may be a mistake."""

    wrong: list[Problem] = field(default_factory=list)
    doubtful: list[Problem] = field(default_factory=list)


def look_at_files(orders: Orders) -> Findings:
    """Open what scenes name, as far as it is here."""
    found = Findings()
    for index, scene in enumerate(orders.protocol.warped.scenes):
        place = f"stimuli.scenes[{index}]"
        try:
            if isinstance(scene, StereoScene):
                _pair(found, place, orders, scene)
            elif isinstance(scene, ExrScene) and scene.has_own_path:
                _sequence(found, place, orders, scene)
        except FileNotFoundError:
            continue
        except (InputError, OSError) as error:
            found.wrong.append(Problem(place, str(error)))
    return found


def _pair(found: Findings, place: str, orders: Orders, scene: StereoScene) -> None:
    if is_built_in(scene, orders.folder):
        return
    pair = read_pair(scene, orders.folder)
    verdict = judge_pair(pair, units_per_px=scene.units_per_px)
    if verdict.doubtful:
        said = f"{scene.left}, {scene.right}, {scene.disparity}: {verdict}"
        (found.wrong if verdict.refused else found.doubtful).append(Problem(place, said))


def _sequence(found: Findings, place: str, orders: Orders, scene: ExrScene) -> None:
    files = frame_files(scene.file, orders.folder)
    wanted = orders.protocol.warped.clips.frames
    if len(files) < wanted:
        found.wrong.append(
            Problem(
                f"{place}.file",
                f"a clip needs {wanted} frames (the sequence has {len(files)} files); shorten"
                " duration_s, or render more",
            )
        )
    size_px = stated_size_px(files[0])
    if size_px is not None and any(
        have < shown for have, shown in zip(size_px, orders.render_px, strict=True)
    ):
        found.wrong.append(Problem(f"{place}.file", too_small(size_px, orders.render_px)))
    sizes = [size.name for size in orders.protocol.warped.sizes if not size.is_own]
    if sizes:
        alike = f"; {' and '.join(sizes)} show the same clip" if len(sizes) > 1 else ""
        found.doubtful.append(
            Problem(
                place,
                f"{scene.name} is a sequence with its own motion: hole_share and extent_m do not"
                f" apply to it{alike}",
            )
        )
