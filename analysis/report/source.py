"""What a report is made from: sittings, or a table of decisions."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from analysis.pairings import pairing_rows
from analysis.plain_csv import read_decisions
from analysis.settings import Settings, from_decisions, from_protocol
from analysis.tidy import Tidy, read_sessions
from protocols.errors import StudyError
from protocols.hashing import Json, sha256_file
from protocols.schema import StudyProtocol

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Source:
    """What was analysed, whichever way it came."""

    decisions: pd.DataFrame
    tidy: Tidy | None
    protocol: StudyProtocol | None
    settings: Settings
    simulated: bool
    provenance: dict[str, Json]
    warnings: tuple[str, ...]


def from_sessions(folder: Path, protocol: StudyProtocol, progress: Progress | None) -> Source:
    """Read every sitting below `folder`.

    Raises
    ------
    StudyError
        As `analysis.tidy.read_sessions`; also if exclusions leave no decision.
    """
    tidy = read_sessions(folder, protocol, progress=progress)
    decisions = tidy.analysed
    if decisions.empty:
        lost = "; ".join(
            f"{step.step}: {step.sittings_out} sittings, {step.decisions_out} decisions out"
            for step in tidy.flow[1:]
            if step.sittings_out or step.decisions_out
        )
        raise StudyError(
            f"{folder}: at least one decision must remain after exclusions"
            f" (none of {tidy.flow[0].decisions_left} does: {lost or 'no main trial was decided'})"
        )
    sessions = tidy.sessions
    provenance: dict[str, Json] = {
        "protocol": protocol.study.name,
        "protocol_version": protocol.study.version,
        "protocol_sha256": protocol.sha256,
        "stimuli_sha256": protocol.stimuli_sha256,
        "manifest_sha256": sorted(set(sessions["manifest_sha256"])),
        "recorded_with": sorted(set(sessions["revision"])),
        "timing_evidence": sorted(set(sessions["timing_evidence"])),
        "journals_sha256": {
            str(name): str(digest)
            for name, digest in zip(sessions["session"], sessions["journal_sha256"], strict=True)
        },
    }
    return Source(
        decisions,
        tidy,
        protocol,
        from_protocol(protocol),
        tidy.simulated,
        provenance,
        tidy.warnings,
    )


def from_table(
    path: Path, protocol: StudyProtocol | None, *, alpha: float, margin: float
) -> Source:
    """Read a table of decisions; a protocol, where given, names methods and rules.

    Raises
    ------
    StudyError
        If the table cannot be read, holds no decision, or does not fit the protocol.
    """
    decisions = read_decisions(path)
    decisions = decisions[(decisions["included"] == 1) & (decisions["kind"] == "main")]
    decisions = decisions.reset_index(drop=True)
    if decisions.empty:
        raise StudyError(f"{path}: must hold at least one main decision that is included")
    settings = from_decisions(decisions, path.stem, alpha=alpha, margin=margin)
    notes = ["imported table: no record of timing, gaze or exclusions can be checked"]
    if protocol is not None:
        settings = from_protocol(protocol)
        unknown = sorted(
            (set(decisions["first"]) | set(decisions["second"])) - set(settings.methods)
        )
        if unknown:
            raise StudyError(
                f"{path}: methods must be those of the protocol"
                f" ({', '.join(settings.methods)}) (got {', '.join(unknown)})"
            )
        if not any(
            len(pairing_rows(decisions, method, against)) for method, against in settings.pairings
        ):
            raise StudyError(f"{path}: must compare at least one of the protocol's pairings")
        notes.append("the protocol's exclusion rules were not applied to this table")
    return Source(
        decisions,
        None,
        protocol,
        settings,
        bool(decisions["simulated"].fillna(0).max()),
        {"table_sha256": sha256_file(path), "protocol_sha256": settings.protocol_sha256},
        tuple(notes),
    )
