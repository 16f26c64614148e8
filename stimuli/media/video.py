"""Videos as folders of frames, and folders of frames as videos; small videos to look at."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.pictures.decode import read_pixels, three_channels
from pipeline.pictures.write import FREE_SPACE, write_error
from pipeline.video_file import VideoFrames, is_video, quiet_stderr
from protocols.disk.locks import clear_files
from protocols.disk.whole_file import whole_path
from protocols.manifest import Clip
from stimuli.media.png import decode_in_8_bits, encode_bytes

CODECS: Final = {".mp4": "mp4v", ".webm": "VP80", ".avi": "FFV1"}
"""Codec by ending: .avi keeps every pixel, the others are smaller."""
_SEGMENT = b"\x18\x53\x80\x67"  # of Matroska: the element of all that follows the head
_TRACK_UID = b"s\xc5\x88"  # of Matroska: the element's name, and that eight bytes follow
_HEAD = 4096  # bytes that hold everything before the frames


@dataclass(frozen=True)
class UnpackedVideo:
    """A video's frames as a folder of PNG, ``000000.png`` on."""

    folder: Path
    fps: float
    frames: int
    notes: list[str]
    """Notes for the user."""


@contextmanager
def unpacked_video(path: Path) -> Iterator[UnpackedVideo]:
    """Give a video's frames as a folder that is gone when the block ends.

    Raises
    ------
    InputError
        As `VideoFrames` raises it, or if there is no frame or no rate.
    """
    video = VideoFrames(path)
    with tempfile.TemporaryDirectory(prefix="metamerlab-frames-") as made:
        folder = Path(made) / path.stem  # scores are told by names of folders
        folder.mkdir()
        count = 0
        try:
            for count, frame in enumerate(video, 1):
                (folder / f"{count - 1:06d}.png").write_bytes(encode_bytes(frame))
        finally:
            video.release()
        if not count or not video.fps:
            raise InputError(
                f"{path}: must have frames and a rate (has {count} at {video.fps:g} a second)"
            )
        notes = list(video.notes)
        if video.promised > count + 1:
            notes.append(
                f"of {video.promised} frames that the video should have, {count} could be read:"
                " was it cut short?"
            )
        yield UnpackedVideo(folder, video.fps, count, notes)


@contextmanager
def folder_of_frames(path: Path, tell: Callable[[str], None]) -> Iterator[Path]:
    """Give a video's frames as a folder for as long as the block lasts; all else as it is.

    `tell` is given each of its notes.
    """
    if not is_video(path):
        yield path
        return
    with unpacked_video(path) as unpacked:
        for note in unpacked.notes:
            tell(f"note: {note}")
        yield unpacked.folder


def check_video(path: Path, width: int, height: int) -> str:
    """Refuse a video that cannot be written in this size; return its codec.

    Raises
    ------
    InputError
        If the ending is another, or an edge is odd where the codec needs even ones.
    """
    codec = CODECS.get(path.suffix.lower())
    if codec is None:
        raise InputError(f"{path}: must end in {', '.join(CODECS)}")
    if codec != "FFV1" and (width % 2 or height % 2):
        raise InputError(
            f"{path}: this kind of video needs even edges (frames are {width} x {height} px); write"
            " .avi, which keeps every pixel"
        )
    return codec


def write_video(path: Path, frames: Sequence[Path], fps: float) -> None:
    """Write pictures of one size as a video, whole or not at all.

    Parameters
    ----------
    path : Path
        Ends in ``.mp4``, ``.webm`` or ``.avi``; see `CODECS`. Its folder is made.
    frames : sequence of Path
        Pictures of 8 or 16 bits, in their order; videos have 8, so 16 are rounded.

    Raises
    ------
    InputError
        If the ending is another, sizes or numbers differ, or an edge is odd where the codec needs
        even ones.
    """
    first = _in_8_bits(frames[0])
    height, width = first.shape[:2]
    check_video(path, width, height)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_video(path, (width, height), fps) as write:
        for file in frames:
            frame = _in_8_bits(file)
            if frame.shape != first.shape:
                raise InputError(
                    f"{file}: must be {width} x {height} px as the frame before (is"
                    f" {frame.shape[1]} x {frame.shape[0]})"
                )
            write(frame)


@contextmanager
def whole_video(
    path: Path, size_px: tuple[int, int], fps: float
) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
    """Yield a writer of frames, (height, width, 3); the video appears when all went well.

    On a full disk OpenCV drops frames and reports success, so the file is read back. Of the same
    frames it has the same bytes. What a killed program left of it is removed before.

    Raises
    ------
    InputError
        If OpenCV cannot write this kind, or the file came out incomplete.
    OSError
        If the disk is full or fails.
    """
    codec, count = check_video(path, *size_px), 0
    clear_files(path)
    with whole_path(path, path.suffix) as temporary:
        with quiet_stderr():
            writer = cv2.VideoWriter(
                str(temporary), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), fps, size_px
            )

        def write(frame: NDArray[np.uint8]) -> None:
            nonlocal count
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
            count += 1

        try:
            if not writer.isOpened():
                raise write_error(
                    path, f"OpenCV made no {codec} here; take another ending, or {FREE_SPACE}"
                )
            yield write
        finally:
            with quiet_stderr():
                writer.release()
        if path.suffix.lower() == ".webm":
            _without_chance(temporary)
        _check_whole(path, temporary, count)


def _check_whole(path: Path, written: Path, count: int) -> None:
    """Read the file back: all frames are there, and the index that follows them is."""
    try:
        video = VideoFrames(written)
        found = len(video)
        video.release()
    except InputError:
        found = 0
    if found != count:
        raise write_error(path, f"of {count} frames only {found} arrived; {FREE_SPACE}")
    if not _ends_where_it_says(written):
        raise write_error(path, f"the end of the file did not arrive; {FREE_SPACE}")


def _ends_where_it_says(path: Path) -> bool:
    """True if a video's outermost parts, as their sizes say, fill the file to its last byte."""
    size, at = path.stat().st_size, 0
    with path.open("rb") as file:
        head = file.read(_HEAD)
        if path.suffix.lower() == ".webm":
            at = head.find(_SEGMENT) + len(_SEGMENT)
            return at + 8 + int.from_bytes(head[at + 1 : at + 8], "big") == size
        while at < size:
            file.seek(at)
            part = file.read(16)
            if path.suffix.lower() == ".avi":
                at += 8 + int.from_bytes(part[4:8], "little")
            else:
                length = int.from_bytes(part[:4], "big")
                at += int.from_bytes(part[8:], "big") if length == 1 else length or size + 1
    return at == size


def _without_chance(path: Path) -> None:
    """Put 1 for the number that FFmpeg draws for a track of WebM: same frames, same bytes."""
    with path.open("r+b") as file:
        head = file.read(_HEAD)
        at = head.find(_TRACK_UID)
        if at >= 0:
            drawn = head[at + len(_TRACK_UID) :][:8]
            file.seek(0)
            file.write(head.replace(b"\xc5\x88" + drawn, b"\xc5\x88" + (1).to_bytes(8, "big")))


def _in_8_bits(path: Path) -> NDArray[np.uint8]:
    pixels = three_channels(path, read_pixels(path))
    if pixels.dtype.kind != "u":
        raise InputError(f"{path}: must have 8 or 16 bits per channel (has {pixels.dtype})")
    return np.asarray(np.rint(pixels / (np.iinfo(pixels.dtype).max / 255)), np.uint8)


PREVIEW_FOLDER = "previews"
LARGEST_PX = 480


def preview_path(out: Path, clip: Clip) -> Path:
    """Return the path of the preview of `clip`; its name carries the clip's hash."""
    return out / PREVIEW_FOLDER / f"{clip.name}.{clip.sha256[:12]}.webm"


def write_preview(out: Path, clip: Clip, path: Path) -> None:
    """Write a WebM (VP8) of at most 480 px, at the clip's rate.

    Raises
    ------
    InputError
        If a frame is damaged, or the video cannot be written.
    """
    scale = min(1.0, LARGEST_PX / max(clip.width_px, clip.height_px))
    size = tuple(max(2, round(scale * edge) // 2 * 2) for edge in (clip.width_px, clip.height_px))
    with whole_video(path, (size[0], size[1]), clip.fps) as write:
        for index in range(len(clip.frames_sha256)):
            frame = decode_in_8_bits(out / clip.frame_path(index))
            small = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
            write(np.asarray(small, np.uint8))
