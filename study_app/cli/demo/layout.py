"""Where everything of a demonstration lies, and what was done when."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from protocols.errors import StudyError
from protocols.result_folder import remove_listed, unlisted
from stimuli.whole_file import write_whole

RECORD_NAME = "demo.json"
_OURS = ("index.html", "pictures", "clips", "sessions", "report", "trial", "studies", "screen.toml")


class Layout:
    """The folder that `metamerlab demo` fills, and what lies where in it."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.page = out / "index.html"
        self.pictures = out / "pictures"  # fills of one pair of photographs
        self.clips = out / "clips"  # of the study, with their manifest
        self.sessions = out / "sessions"  # journals of all observers
        self.report = out / "report"
        self.trial = out / "trial"  # pictures of one trial as it stood on the screen
        self.studies = out / "studies"  # a folder for each study on foveated pictures
        self.screen = out / "screen.toml"  # the display file of the screen without a monitor

    def prepare(self) -> None:
        """Make the folder.

        Raises
        ------
        StudyError
            If it holds files with our names that no demonstration wrote.
        """
        self.out.mkdir(parents=True, exist_ok=True)
        if (self.out / RECORD_NAME).exists():
            return
        for name in _OURS:
            if (self.out / name).exists():
                raise StudyError(
                    f"{self.out}: must be empty or made by 'metamerlab demo' (it holds {name}"
                    f" but no {RECORD_NAME}); choose another --out, or move it away"
                )

    def clear(self, folder: Path) -> None:
        """Remove a part of what demonstrations made, to make it again.

        Raises
        ------
        StudyError
            If it holds what none listed as its own: a user's, or of a demonstration that was
            killed.
        """
        if not folder.is_dir():
            return
        for theirs in unlisted(self.out, folder):
            raise StudyError(
                f"{folder}: must hold nothing but what a demonstration listed as its own (it holds"
                f" {theirs.relative_to(folder)}); move that folder away, or choose another --out"
            )
        remove_listed(self.out, folder)


class Record:
    """What was done and how long it took: ``demo.json``, so that a second run keeps it."""

    def __init__(self, layout: Layout) -> None:
        self._path = layout.out / RECORD_NAME
        try:
            known = json.loads(self._path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            known = {}
        self._steps: dict[str, dict[str, object]] = known if isinstance(known, dict) else {}
        self._write()

    def matches(self, step: str, key: str) -> bool:
        """Whether the step was done before, from the same things."""
        return self._steps.get(step, {}).get("key") == key

    def seconds(self, step: str) -> float:
        """How long the step took when it was done; 0 if it never was."""
        return float(str(self._steps.get(step, {}).get("seconds", 0.0)))

    def notes(self, step: str) -> Mapping[str, object]:
        """What the step left to be told."""
        found = self._steps.get(step, {}).get("notes", {})
        return found if isinstance(found, dict) else {}

    def done(
        self, step: str, key: str, seconds: float, notes: Mapping[str, object] | None = None
    ) -> None:
        """Note that a step is done."""
        self._steps[step] = {"key": key, "seconds": round(seconds, 2), "notes": dict(notes or {})}
        self._write()

    def forget(self, step: str) -> None:
        """Note that a step has to be done again."""
        if self._steps.pop(step, None) is not None:
            self._write()

    def _write(self) -> None:
        text = json.dumps(self._steps, indent=1, sort_keys=True) + "\n"
        write_whole(self._path, text.encode("utf-8"))
