"""All that a video file says, by its container, its coded stream and OpenCV."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import cv2

from pipeline.errors import InputError
from pipeline.statements.check_statements import VideoStatement
from pipeline.video_header import avi, matroska, mp4
from pipeline.video_header.coding import UNSAID, of_pixel_format, of_stream
from protocols.outside import reading

_HEARD: Final = (b"h264", b"avc1", b"FMP4", b"mp4v")
"""Codecs whose own words on colour are known here."""
_Y_CB_CR: Final = (b"I42", b"444", b"422", b"Y42", b"Y3\x0b", b"Y3\x0a", b"Y3\x00")
_SD_LINES: Final = 576
_BY_CODING: Final = -1
"""OpenCV's format of frames that are not decoded."""


def statements(path: Path, video: cv2.VideoCapture) -> Iterator[VideoStatement]:
    """Yield the statements of an opened video, but the default of each.

    Raises
    ------
    InputError
        If its header is damaged.
    """
    matrix, mapped = UNSAID, False
    with reading(path, "a video whose header is whole", InputError):
        for said in _container(path)(path):
            matrix, mapped = _matrix(said, matrix), mapped or said.statement == "PQ, HLG"
            yield said
        across, down = video.get(cv2.CAP_PROP_SAR_NUM), video.get(cv2.CAP_PROP_SAR_DEN)
        if across > 0 and down > 0 and across != down:
            yield VideoStatement("pixel aspect", f"its pixels are {across:g}:{down:g}")
        pixels = number_bytes(video, cv2.CAP_PROP_CODEC_PIXEL_FORMAT)
        # The reader sees the alpha of BGRA, but then OpenCV maps no light.
        yield from of_pixel_format(b"RGBA" if mapped and pixels == b"BGRA" else pixels)
        codec = number_bytes(video, cv2.CAP_PROP_FOURCC)
        for said in of_stream(codec, *_coded(path), matrix):
            matrix = _matrix(said, matrix)
            yield said
        lines = round(
            min(video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT))
        )
        if matrix == UNSAID and pixels[:3] in _Y_CB_CR and codec in _HEARD and lines > _SD_LINES:
            yield VideoStatement("no colour matrix", "it does not say its colour matrix")


def _matrix(said: VideoStatement, known: int) -> int:
    """Return the colour matrix, once something has said it."""
    found = said.values.get("matrix", UNSAID)
    return found if known == UNSAID and isinstance(found, int) else known


def number_bytes(video: cv2.VideoCapture, key: int) -> bytes:
    """Return a property of OpenCV that is four characters."""
    return (int(video.get(key)) & 0xFFFFFFFF).to_bytes(4, "little")


def _container(path: Path) -> Callable[[Path], Iterator[VideoStatement]]:
    with path.open("rb") as file:
        head = file.read(12)
    if head[:4] == b"\x1aE\xdf\xa3":
        return matroska.statements
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return avi.statements
    if head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot", b"uuid"):
        return mp4.statements
    return _other


def _other(path: Path) -> Iterator[VideoStatement]:  # noqa: ARG001
    yield VideoStatement("whatever else", "its header is none of MP4, MOV, Matroska, WebM or AVI")


def _coded(path: Path) -> tuple[bytes, bytes]:
    """Return the headers and the first packet of the coded stream."""
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, _BY_CODING])
    try:
        _, packet = video.read()
        place = int(video.get(cv2.CAP_PROP_CODEC_EXTRADATA_INDEX))
        done, header = video.retrieve(flag=place) if place >= 0 else (False, None)
    finally:
        video.release()
    return (
        header.tobytes() if done and header is not None else b"",
        packet.tobytes() if packet is not None else b"",
    )
