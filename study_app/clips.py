"""Stimuli on their way to the screen: read, checked against their hashes, decoded, uploaded.

Those of two trials have a place in graphics memory: of the one that is shown, and of the next. A
thread reads and
decodes only while `allow` is on; `pump`, called by the thread that owns the context, uploads.
"""

from __future__ import annotations

import io
import queue
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import moderngl
import numpy as np
import psutil
from numpy.typing import NDArray
from PIL import Image

from pipeline.gl.context import describe
from protocols.disk.hashing import sha256_bytes
from protocols.disk.whole_file import read_bytes
from protocols.errors import StudyError
from protocols.manifest import Clip, Manifest
from protocols.outside import reading

Names: TypeAlias = tuple[str, ...]
"""The stimuli of one trial, as its task counts them."""
_DECODED_AHEAD = 4  # frames that wait in memory for their upload


def frame_bytes(folder: Path, clip: Clip, index: int) -> bytes:
    """Return the file of one frame, which is the one that was hashed.

    Raises
    ------
    StudyError
        If it is missing, or changed since.
    """
    path = folder / clip.frame_path(index)
    data = read_bytes(path, "a frame of the study")
    then, found = clip.frames_sha256[index], sha256_bytes(data)
    if found != then:
        raise StudyError(
            f"{path}: must be the frame that was hashed ({then[:12]}, got {found[:12]}); restore"
            " it, or run 'metamerlab stimuli build' again"
        )
    return data


def read_frame(folder: Path, clip: Clip, index: int) -> NDArray[np.uint8]:
    """Read one frame and check it against the manifest.

    Returns
    -------
    ndarray of shape (height, width, 4)
        RGBA; alpha is 255.

    Raises
    ------
    StudyError
        If the file is missing, changed since it was hashed, or no 8-bit RGB image of its size.
    """
    path = folder / clip.frame_path(index)
    data = frame_bytes(folder, clip, index)
    with (
        reading(path, "a PNG frame that can be read", StudyError),
        Image.open(io.BytesIO(data)) as image,
    ):
        if image.mode not in ("RGB", "RGBA") or image.size != (clip.width_px, clip.height_px):
            raise StudyError(
                f"{path}: must be an 8-bit RGB image of {clip.width_px}x{clip.height_px} (got"
                f" {image.mode}, {image.width}x{image.height}); frames are shown as they are"
            )
        return np.asarray(image.convert("RGBA"))


def check_files(folder: Path, manifest: Manifest) -> None:
    """Refuse a folder that lacks frames; content is checked when a frame is read.

    Raises
    ------
    StudyError
        Naming the first missing files, and how many there are.
    """
    if manifest.simulated:
        raise StudyError(f"{folder}: must hold clips with pixels (this manifest is simulated)")
    for clip in manifest.clips:
        if clip.bit_depth != 8:
            raise StudyError(
                f"{clip.name}: clips that are shown must have 8 bits (got {clip.bit_depth});"
                " set clips.bit_depth = 8 and build again"
            )
    missing = [
        clip.frame_path(index)
        for clip in manifest.clips
        for index in range(len(clip.frames_sha256))
        if not (folder / clip.frame_path(index)).is_file()
    ]
    if missing:
        shown = ", ".join(missing[:3]) + (", ..." if len(missing) > 3 else "")
        raise StudyError(
            f"{folder}: must hold every frame of the manifest (missing {len(missing)}: {shown});"
            " restore them, or run 'metamerlab stimuli build' again"
        )


@dataclass
class _Slot:
    """One trial's place in graphics memory."""

    arrays: tuple[moderngl.TextureArray, ...]
    names: Names | None = None
    left: int = 0
    """Frames not yet uploaded."""
    error: Exception | None = None
    """Error while it was read; told when the trial comes, not in another trial."""


@dataclass
class _Job:
    names: Names
    cancelled: threading.Event = field(default_factory=threading.Event)


class ClipStore:
    """The stimuli of two trials as RGBA8 texture arrays.

    Parameters
    ----------
    ctx : moderngl.Context
        The window's, current in this thread.
    folder : Path
        The clips.
    manifest : Manifest
        Whose clips all have one size and length.
    per_trial : int
        How many stimuli a trial has.

    Raises
    ------
    StudyError
        If those of two trials do not fit the graphics memory.
    """

    def __init__(
        self, ctx: moderngl.Context, folder: Path, manifest: Manifest, per_trial: int
    ) -> None:
        self._folder, self._manifest = folder, manifest
        clip = manifest.clips[0]
        self.size = clip.width_px, clip.height_px
        self.frames = len(clip.frames_sha256)
        self._slots = _allocate(ctx, self.size, self.frames, per_trial)
        self._shown = 0
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._job: _Job | None = None
        self._decoded: queue.Queue[tuple[_Job, int, int, NDArray[np.uint8] | Exception]] = (
            queue.Queue(_DECODED_AHEAD)
        )
        self._allowed = threading.Event()
        self._stopped = False
        self._thread = threading.Thread(target=self._work, name="clips", daemon=True)
        self._thread.start()

    def allow(self, on: bool) -> None:
        """Let the thread read and decode, or have it rest after the frame it is at."""
        if on:
            self._allowed.set()
        else:
            self._allowed.clear()

    def expect(self, names: Names) -> None:
        """Announce the stimuli that come next; they are loaded beside those that are shown."""
        if any(slot.names == names for slot in self._slots):
            return
        if self._job is not None:
            self._job.cancelled.set()
        spare = self._slots[1 - self._shown]
        spare.names, spare.left, spare.error = names, len(names) * self.frames, None
        self._job = _Job(names)
        self._jobs.put(self._job)

    def pump(self, until_s: float) -> bool:
        """Upload what is decoded until the monotonic clock reads `until_s`; at least one frame.

        Returns
        -------
        bool
            Whether anything was there to upload.
        """
        worked = False
        while not (worked and time.monotonic() >= until_s):
            try:
                job, clip, index, frame = self._decoded.get_nowait()
            except queue.Empty:
                return worked
            if job.cancelled.is_set():
                continue
            spare = self._slots[1 - self._shown]
            if isinstance(frame, Exception):
                spare.error = spare.error or frame
                continue
            spare.arrays[clip].write(frame, viewport=(0, 0, index, *self.size, 1))
            spare.left -= 1
            worked = True
        return worked

    def ready(self, names: Names) -> bool:
        """Return True if every frame of these stimuli is in graphics memory.

        Raises
        ------
        StudyError
            As `read_frame`: what came up while it was read.
        """
        for slot in self._slots:
            if slot.names == names and slot.error is not None:
                slot.names, error = None, slot.error
                raise error
        return any(slot.names == names and slot.left == 0 for slot in self._slots)

    def show(self, names: Names) -> tuple[moderngl.TextureArray, ...]:
        """Return the arrays of stimuli that are ready, and free the other place for the next."""
        self._shown = next(i for i, slot in enumerate(self._slots) if slot.names == names)
        return self._slots[self._shown].arrays

    def too_slow(self, waited_s: float) -> StudyError:
        """Return the error on a disk that gives nothing any more."""
        return StudyError(
            f"{self._folder}: the next frame must come from the disk (none came for {waited_s:g}"
            " s); everything up to here is saved. See to the disk or its network, copy the clips to"
            " a disk of this machine, then run 'metamerlab session resume'"
        )

    def close(self) -> None:
        """Stop the thread and free the memory."""
        self._stopped = True
        if self._job is not None:
            self._job.cancelled.set()
        self._allowed.set()
        self._jobs.put(None)
        self._thread.join(timeout=5.0)
        for slot in self._slots:
            for array in slot.arrays:
                array.release()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            for clip, name in enumerate(job.names):
                for index in range(self.frames):
                    self._allowed.wait()
                    if job.cancelled.is_set():
                        break
                    try:
                        frame: NDArray[np.uint8] | Exception = read_frame(
                            self._folder, self._manifest.clip(name), index
                        )
                    except Exception as error:  # told by the thread that shows
                        frame = error
                    self._hand_over(job, clip, index, frame)

    def _hand_over(
        self, job: _Job, clip: int, index: int, frame: NDArray[np.uint8] | Exception
    ) -> None:
        while not self._stopped and not job.cancelled.is_set():
            try:
                self._decoded.put((job, clip, index, frame), timeout=0.05)
            except queue.Full:
                continue
            return


def _allocate(
    ctx: moderngl.Context, size: tuple[int, int], frames: int, per_trial: int
) -> tuple[_Slot, _Slot]:
    """Make the texture arrays of two trials, or say why not."""
    count = 2 * per_trial
    needed = count * frames * size[0] * size[1] * 4
    mib = needed / 2**20
    layers = int(ctx.info["GL_MAX_ARRAY_TEXTURE_LAYERS"])
    if frames > layers:
        raise StudyError(
            f"clips must have at most {layers} frames on this graphics driver (got {frames});"
            " shorten them"
        )
    if describe(ctx).software:
        free = psutil.virtual_memory().available
        if needed > 0.9 * free:
            raise StudyError(_too_little(mib, f"{free / 2**20:.0f} MiB are free"))
    made: list[moderngl.TextureArray] = []
    ctx.clear_errors()
    for _ in range(count):
        try:
            array = ctx.texture_array((*size, frames), 4)
        except moderngl.Error:
            array = None
        error = ctx.error
        if array is None or error != "GL_NO_ERROR":
            for other in made:
                other.release()
            raise StudyError(_too_little(mib, f"the driver answered {error}"))
        array.filter = (moderngl.NEAREST, moderngl.NEAREST)
        made.append(array)
    return _Slot(tuple(made[:per_trial])), _Slot(tuple(made[per_trial:]))


def _too_little(mib: float, found: str) -> str:
    return (
        f"graphics memory must hold the stimuli of two trials, {mib:.0f} MiB ({found}); shorten"
        " clips, make stimuli smaller, or free memory"
    )
