"""Participants from their first page to the analysis (CONSORT's flow), and what they said of them.

Whoever withdrew counts, and nothing else of theirs is known.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from analysis.journals import StudyReadings
from protocols.journal import Consent
from protocols.study_file.schema import StudyProtocol

EACH_TRIAL = "no answer remained that the rules for single trials keep"


@dataclass(frozen=True)
class ParticipantFlow:
    """Counts of the participants who reached each stage; each has one session.

    Attributes
    ----------
    consent_asked : bool
        Whether the study asks for consent; if not, all whose journal can be read took part.
    began : int
        Have a session, whatever it holds.
    withdrew, unreadable, refused : int
        Are out before any rule: on their own wish, by a journal whose header cannot be read, by
        not consenting.
    unasked : int
        Ended before they consented or refused; 0 where the study asks for no consent.
    consented : int
        The rest.
    completed : int
        Of those that consented, sessions that ran to their end.
    stopped : mapping of how their session ended to int
        The others of those.
    left_out : mapping of the rule to int
        Of those that consented, by the first rule that leaves them out.
    analysed : int
        Have a decision that the rules keep.
    """

    consent_asked: bool
    began: int
    withdrew: int
    unreadable: int
    refused: int
    unasked: int
    consented: int
    completed: int
    stopped: Mapping[str, int]
    left_out: Mapping[str, int]
    analysed: int

    @property
    def steps(self) -> tuple[tuple[str, str, int], ...]:
        """Stage, reason (none: all who reached it) and count; no reason that nobody had."""
        out = {
            "withdrew": self.withdrew,
            "journal cannot be read": self.unreadable,
            "refused consent": self.refused,
            "ended before consent": self.unasked,
        }
        stages: tuple[tuple[str, int, Mapping[str, int]], ...] = (
            ("began", self.began, out),
            ("consented" if self.consent_asked else "took part", self.consented, {}),
            ("completed the session", self.completed, self.stopped),
            ("analysed", self.analysed, self.left_out),
        )
        return tuple(
            step
            for stage, count, reasons in stages
            for step in (
                (stage, "", count),
                *((stage, why, number) for why, number in reasons.items() if number),
            )
        )


def participant_flow(
    recorded: StudyReadings, study: StudyProtocol, sessions: pd.DataFrame, decisions: pd.DataFrame
) -> ParticipantFlow:
    """Count participants; `sessions` and `decisions` are marked by the rules."""
    asked = study.privacy.consent_required
    agreed = {
        reading.name
        for reading in recorded.readings
        if not asked or any(isinstance(e, Consent) and e.agreed for e in reading.journal.events)
    }
    refused = int((sessions["status"] == "consent-refused").sum())
    inside = sessions[sessions["session"].isin(agreed) & (sessions["status"] != "consent-refused")]
    kept = set(decisions["session"][decisions["included"] == 1])
    out = inside[~inside["session"].isin(kept)]
    return ParticipantFlow(
        consent_asked=asked,
        began=len(sessions) + recorded.withdrew + recorded.unreadable,
        withdrew=recorded.withdrew,
        unreadable=recorded.unreadable,
        refused=refused,
        unasked=len(sessions) - refused - len(inside),
        consented=len(inside),
        completed=int((inside["status"] == "completed").sum()),
        stopped=Counter(inside["status"][inside["status"] != "completed"]),
        left_out=Counter(out["excluded"].replace("", EACH_TRIAL)),
        analysed=len(inside) - len(out),
    )


def demographics(
    answers: pd.DataFrame, study: StudyProtocol, decisions: pd.DataFrame
) -> pd.DataFrame:
    """Count answers to closing questions that have choices.

    Returns
    -------
    DataFrame
        ``question``, ``asked`` (its text), ``answer``, ``participants``: how many chose it, and
        ``analysed``: how many of these are analysed. In the default language; the last answer of
        each question, "no answer", counts the rest of those analysed and of all who answered any.
    """
    languages = study.text.languages
    shown = languages[study.text.default_language].questions
    kept = set(decisions["session"][decisions["included"] == 1])
    people = {*answers["session"], *kept}
    rows = []
    for number, question in enumerate(shown):
        if not question.choices:
            continue
        place = {
            text: at
            for one in languages.values()
            for at, text in enumerate(one.questions[number].choices)
        }
        own = answers[answers["question"] == question.name].drop_duplicates("session", keep="last")
        chosen = dict(zip(own["session"], own["text"].map(place), strict=True))
        counted = [(name, {who for who, at in chosen.items() if at == k})
                   for k, name in enumerate(question.choices)]  # fmt: skip
        counted.append(("no answer", people.difference(*(who for _, who in counted))))
        rows += [
            {
                "question": question.name,
                "asked": question.text,
                "answer": name,
                "participants": len(who),
                "analysed": len(who & kept),
            }
            for name, who in counted
        ]
    return pd.DataFrame(rows, columns=["question", "asked", "answer", "participants", "analysed"])
