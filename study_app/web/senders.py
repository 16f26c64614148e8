"""Results and workers of JATOS by which lines came, as its archives tell."""

from __future__ import annotations

import re
from collections import defaultdict

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from protocols.browser.shared_links import Mark
from protocols.limits import limit

METADATA = "metadata.json"
COMPONENT_RESULT, STUDY_RESULT = "component result of JATOS", "study result of JATOS"
WORKER = "worker of JATOS"
_FOLDERS = {
    COMPONENT_RESULT: re.compile(r"(?:^|/)comp-result_(\w{1,64})/"),
    STUDY_RESULT: re.compile(r"(?:^|/)study_result_(\w{1,64})/"),
}


class _Told(BaseModel):
    """Part of `metadata.json`: JATOS adds keys with every version."""

    model_config = ConfigDict(extra="ignore", coerce_numbers_to_str=True)
    id: str = Field(max_length=64)


class _StudyResult(_Told):
    worker: str | None = Field(default=None, alias="workerId", max_length=64)
    components: tuple[_Told, ...] = Field(default=(), alias="componentResults")


class _Study(BaseModel):
    results: tuple[_StudyResult, ...] = Field(default=(), alias="studyResults")


class _Metadata(BaseModel):
    data: tuple[_Study, ...] = ()


class Senders:
    """Marks of texts, as archives tell them."""

    def __init__(self) -> None:
        self._results: dict[Mark, set[Mark]] = defaultdict(set)
        """Marks that belong to a result."""

    def read(self, metadata: bytes) -> bool:
        """Take a `metadata.json`; False where it is not as JATOS writes it."""
        if metadata.count(b"{") > limit("events"):
            return False
        try:
            told = _Metadata.model_validate_json(metadata)
        except ValidationError:
            return False
        for result in (result for study in told.data for result in study.results):
            own = (STUDY_RESULT, result.id)
            marks = {own} if result.worker is None else {own, (WORKER, result.worker)}
            for mark in (own, *((COMPONENT_RESULT, one.id) for one in result.components)):
                self._results[mark] |= marks
        return True

    def marks(self, place: str) -> set[Mark]:
        """Return the marks of a text, by its place in an archive or folder."""
        own = {
            (kind, found[-1])
            for kind, pattern in _FOLDERS.items()
            if (found := pattern.findall(place))
        }
        return own.union(*(self._results[mark] for mark in own if mark in self._results))
