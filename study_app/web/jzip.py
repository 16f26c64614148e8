"""An exported folder as a study archive that JATOS imports (version 3.9 and later), and its rules.

JATOS reads ``NAME.jas``, a description in JSON, and one folder beside it. `problems` restates what
its import checks, so that an archive that it would refuse is never written.
"""

from __future__ import annotations

import json
import re
import uuid
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from protocols.disk.whole_file import whole_path
from protocols.errors import StudyError
from protocols.limits import FIXED

VERSION = "3"
MOST_BYTES = FIXED["jatos"].most
RESERVED = frozenset({"jatos", "publix", "public", "assets", "study_assets", "study_assets_root"})
WORKERS = frozenset(
    {"Jatos", "PersonalSingle", "PersonalMultiple", "GeneralSingle", "GeneralMultiple", "MT",
     "MTSandbox"}
)  # fmt: skip
OURS = ("PersonalSingle", "GeneralSingle", "MT")
"""Kinds of links that open the study once for each person."""
_KEYS = {
    "uuid", "title", "description", "groupStudy", "linearStudy", "allowPreview", "dirName",
    "comments", "jsonData", "endRedirectUrl", "studyEntryMsg", "componentList", "batchList",
}  # fmt: skip
_PAGE = re.compile(r"[\w-][\w/-]*\.[\w-]+", re.ASCII)
_HTML = re.compile(r"<[a-zA-Z/!]")


def describe(name: str, title: str, page: str, identity: str, people: int) -> dict[str, Any]:
    """Return the text of a ``.jas`` on a study with one page.

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
        "version": VERSION,
        "data": {
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
        },
    }


def write(folder: Path, description: dict[str, Any], out: Path) -> None:
    """Write an archive of a folder; the same folder gives the same bytes.

    Raises
    ------
    StudyError
        If there is such a file, or JATOS would refuse the archive.
    """
    if out.exists():
        raise StudyError(f"{out}: must not exist yet; name a new file, or remove it")
    name = description["data"]["dirName"]
    with whole_path(out) as part:
        with zipfile.ZipFile(part, "w", zipfile.ZIP_STORED) as archive:
            text = json.dumps(description, ensure_ascii=False).encode()
            archive.writestr(zipfile.ZipInfo(f"{name}.jas"), text)
            for path in sorted(folder.rglob("*")):
                if path.is_file() and not path.name.startswith("."):
                    place = zipfile.ZipInfo(f"{name}/{path.relative_to(folder).as_posix()}")
                    archive.writestr(place, path.read_bytes())
        if wrong := list(problems(part)):
            raise StudyError(f"{out}: JATOS would refuse the archive: " + "; ".join(wrong))


def problems(path: Path) -> Iterator[str]:
    """Yield the reasons for which JATOS would refuse an archive."""
    if path.stat().st_size > MOST_BYTES:
        yield f"must have at most {MOST_BYTES >> 30} GiB (has {path.stat().st_size >> 20} MiB)"
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        for name in names:
            if name.startswith("/") or ".." in name.split("/") or "\\" in name:
                yield f"file names must stay in the archive (got {name!r})"
        described = [name for name in names if "/" not in name and name.endswith(".jas")]
        folders = sorted({name.split("/")[0] for name in names if "/" in name})
        if len(described) != 1 or len(folders) != 1:
            yield (
                "must hold one .jas file and one folder at its top (got"
                f" {', '.join([*described, *folders]) or 'nothing'})"
            )
            return
        whole = json.loads(archive.read(described[0]))
    if str(whole.get("version")) != VERSION:
        yield f"version must be {VERSION} (got {whole.get('version')!r})"
    study = whole["data"]
    unknown = sorted(set(study) - _KEYS)
    if unknown:
        yield f"keys must be those that JATOS knows (got {', '.join(unknown)})"
    if study["dirName"] != folders[0]:
        yield f"dirName must be the folder's name, {folders[0]} (got {study['dirName']!r})"
    if study["dirName"] in RESERVED or len(study["dirName"]) > 255:
        yield f"dirName must be at most 255 characters, and no reserved one ({study['dirName']!r})"
    if len((study.get("studyEntryMsg") or "").encode()) > 1000:
        yield "studyEntryMsg must have at most 1000 bytes"
    parts = [
        ("study", study),
        *(("component", one) for one in study["componentList"]),
        *(("batch", one) for one in study["batchList"]),
    ]
    for what, part in parts:
        yield from _texts(what, part)
    yield from _components(study, set(names))


def _texts(what: str, part: dict[str, Any]) -> Iterator[str]:
    title = part.get("title") or ""
    if not 1 <= len(title.strip()) <= 255:
        yield f"{what}: title must have 1 to 255 characters (has {len(title)})"
    for key in ("title", "description", "comments", "endRedirectUrl", "studyEntryMsg", "uuid"):
        if _HTML.search(part.get(key) or ""):
            yield f"{what}: {key} must hold no HTML (got {part[key]!r})"


def _components(study: dict[str, Any], names: set[str]) -> Iterator[str]:
    for one in study["componentList"]:
        page = one["htmlFilePath"]
        if not _PAGE.fullmatch(page):
            yield f"htmlFilePath must be letters, digits, - and _, with an ending (got {page!r})"
        if f"{study['dirName']}/{page}" not in names:
            yield f"the page must be in the folder (there is no {page})"
    identities = [one["uuid"] for one in study["componentList"]]
    if len(set(identities)) < len(identities):
        yield "components must differ in uuid"
    for batch in study["batchList"]:
        strange = sorted(set(batch["allowedWorkerTypes"]) - WORKERS)
        if strange:
            yield f"worker types must be those of JATOS (got {', '.join(strange)})"
