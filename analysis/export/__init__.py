"""Exports of recorded studies: BIDS, pwcmp, and what a public export omits."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from protocols.display import Display

Format: TypeAlias = Literal["bids", "pwcmp"]
RecordedEye: TypeAlias = Literal["left", "right", "cyclopean"]
FORMATS: tuple[Format, ...] = get_args(Format)
EYES: tuple[RecordedEye, ...] = get_args(RecordedEye)


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export.

    Attributes
    ----------
    public : bool
        Leave out what could tell who took part, where, and when.
    displays : tuple of Display
        What the sessions were shown on; each session finds its own by hash. BIDS only.
    recorded_eye : str
        Which eye the tracker reported; journals do not say. BIDS only.
    authors, licence : tuple of str, str
        As the export's description is to name them.
    """

    public: bool = False
    displays: tuple[Display, ...] = ()
    recorded_eye: RecordedEye = "cyclopean"
    authors: tuple[str, ...] = ()
    licence: str = ""
