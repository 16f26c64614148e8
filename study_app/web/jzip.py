"""An exported folder as a study archive that JATOS imports (version 3.9 and later).

JATOS reads ``NAME.jas``, a description in JSON, and one folder beside it.
"""

from __future__ import annotations

import json
import re
import uuid
import zipfile
from pathlib import Path

from protocols.disk.hashing import Json
from protocols.disk.whole_file import whole_path
from protocols.errors import StudyError
from protocols.limits import FIXED

VERSION = "3"
MOST_BYTES = FIXED["jatos"].most
RESERVED = frozenset({"jatos", "publix", "public", "assets", "study_assets", "study_assets_root"})
OURS = ("PersonalSingle", "GeneralSingle", "MT")
"""Kinds of links that open the study once for each person."""
_HTML = re.compile(r"<[a-zA-Z/!]")


def jas_text(name: str, title: str, page: str, identity: str, people: int) -> dict[str, Json]:
    """Return the data of a ``.jas`` on a study with one page.

    Parameters
    ----------
    name : str
        Of the study: its folder's name.
    title : str
        What people read.
    page : str
        File of the page, in the folder.
    identity : str
        What makes this export differ from all others: JATOS knows studies by it.
    people : int
        Planned participants: no more links are given.
    """

    def named(what: str) -> str:
        return str(uuid.uuid5(uuid.NAMESPACE_URL, f"metamerlab:{identity}:{what}"))

    shown = _HTML.sub("(", title)[:255]
    return {
        "uuid": named("study"),
        "title": shown,
        "description": "",
        "groupStudy": False,
        "linearStudy": False,
        "allowPreview": False,
        "dirName": f"{name}-study" if name in RESERVED else name,
        "comments": "",
        "jsonData": None,
        "endRedirectUrl": None,
        "studyEntryMsg": None,
        "componentList": [
            {
                "uuid": named("component"),
                "title": shown,
                "htmlFilePath": page,
                "reloadable": True,
                "active": True,
                "comments": "",
                "jsonData": None,
            }
        ],
        "batchList": [
            {
                "uuid": named("batch"),
                "title": "Default",
                "active": True,
                "maxActiveMembers": None,
                "maxTotalMembers": None,
                "maxTotalWorkers": people,
                "allowedWorkerTypes": list(OURS),
                "comments": None,
                "jsonData": None,
            }
        ],
    }


def write(folder: Path, description: dict[str, Json], out: Path) -> None:
    """Write an archive of a folder; the same folder gives the same bytes.

    Raises
    ------
    StudyError
        If there is such a file, or JATOS would refuse the archive.
    """
    if out.exists():
        raise StudyError(f"{out}: must not exist yet; name a new file, or remove it")
    name = description["dirName"]
    with whole_path(out) as part:
        with zipfile.ZipFile(part, "w", zipfile.ZIP_STORED) as archive:
            text = json.dumps({"version": VERSION, "data": description}, ensure_ascii=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.jas"), text.encode())
            for path in sorted(folder.rglob("*")):
                if path.is_file() and not path.name.startswith("."):
                    place = zipfile.ZipInfo(f"{name}/{path.relative_to(folder).as_posix()}")
                    archive.writestr(place, path.read_bytes())
        if (size := part.stat().st_size) > MOST_BYTES:
            raise StudyError(
                f"{out}: JATOS would refuse the archive: must have at most {MOST_BYTES >> 30} GiB"
                f" (has {size >> 20} MiB)"
            )
