"""Columns of tables, and words for missing, yes, no, first, second and ties: one list for all."""

import re

import pandas as pd

from protocols.columns import Column, attempted, decided
from protocols.tasks.pairs import CHOICE_COLUMNS, PAIR_COLUMNS, SCENE_COLUMNS
from protocols.tasks.rating import RATING_COLUMNS
from protocols.tasks.single import ANSWER_COLUMNS

OURS = {
    column.name: column
    for column in (
        *attempted((*SCENE_COLUMNS, *PAIR_COLUMNS), CHOICE_COLUMNS),
        *decided((), (*ANSWER_COLUMNS, *RATING_COLUMNS)),
    )
}
"""All columns that analyses know, by name."""
RAN_OUT = {
    *("timeout", "timedout", "toolate", "tooslow", "noresponse", "noresp", "noanswer", "nokey"),
    *("nokeypress", "nopress", "nobutton", "noinput", "didnotrespond", "didnotanswer"),
    *("unanswered", "notanswered", "omission", "expired", "timeup", "notresponded"),
    *("noresponsegiven", "responsetimeout", "trialtimeout", "maxduration"),
}
"""Words of any column that say: nobody answered in time."""
MISSING = {
    *("", "none", "null", "nil", "na", "n/a", "nan", "undefined", "missing", "blank", "empty"),
    *("norating", "nochoice", "omitted", "skipped", "nr", "k.a", "keineantwort"),
    *RAN_OUT,
}
"""No answer; written without blanks, hyphens and brackets."""
YES = {"1", "1.0", "100%", "true", "t", "yes", "y", "correct", "right", "ja", "richtig"}
NO = {"0", "0.0", "0%", "false", "f", "no", "n", "incorrect", "wrong", "nein", "falsch"}
FIRST = {"first", "left", "1", "a"}
SECOND = {"second", "right", "2", "b"}
CHOSE_FIRST = {"1.0", "true", "yes", *FIRST}
CHOSE_SECOND = {"0", "0.0", "-1", "-1.0", "false", "no", *SECOND}
TIES = {"tie", "tied", "equal", "same", "both", "draw", "neither", "nopreference", "=", "0", "0.5"}
UNANSWERED = {
    *("timeout", "timedout", "noresponse", "skipped", "unanswered", "toolate", "tooslow", "missed"),
    *("istimeout", "wastimeout", "hastimedout", "didtimeout", "trialtimeout", "responsetimeout"),
    *("rttimeout", "timeoutreached", "omission", "expired", "ranout", "timeup"),
}
"""Columns whose yes says that there was no answer."""
ANSWERED = {"answered", "responded", "hasresponse", "hasanswer", "responsegiven"}
"""Columns whose no says so."""
SUMMARY = re.compile(
    r"(grand )?(mean|average|avg|median|(sub)?total|sum|(over)?all|std|sd|sem|mittelwert|summe)s?"
    r"([\s:(].*)?",
    re.IGNORECASE,
)
"""Names of rows that sum up others."""
_EDGES = " \t-\u2013\u2014_.?()[]<>{}\"'#!*"
_BETWEEN = re.compile(r"[\s_-]+")


def plain(text: str) -> str:
    """Return a word without what programs put around and into it."""
    return _BETWEEN.sub("", text.casefold().strip(_EDGES))


def among(values: pd.Series, words: set[str]) -> pd.Series:
    """Return True where a value is one of the words, however it is written."""
    known = {one: one.strip().casefold() in words for one in values.unique()}
    return values.map(known).astype(bool)


def missing(values: pd.Series, answers: set[str] | None = None) -> pd.Series:
    """Return True where a value says: none; `answers` (casefolded) are answers anyway."""
    kept = {one for one in answers or () if one}
    known = {
        one: plain(one) in MISSING and one.strip().casefold() not in kept for one in values.unique()
    }
    return values.map(known).astype(bool)


def ended(values: pd.Series) -> pd.Series:
    """Return True where a value says that time ran out, as ``timeout`` of ``ended_on`` does."""
    known = {one: plain(one) in RAN_OUT for one in values.unique()}
    return values.map(known).astype(bool)


def means(name: str, column: Column) -> bool:
    """Return True if other programs call a column so: ``key_resp.rt`` is ``rt_s``."""
    own = re.sub(r"[\W_]+", "_", name.rpartition(".")[2]).strip("_").casefold()
    return own in (column.name, *column.aliases)
