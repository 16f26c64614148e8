"""A table of any program under our names, and its columns as checked values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from analysis.tables import column_units
from analysis.tables import unwanted_rows as row_checks
from analysis.tables.counts import Counted
from analysis.tables.spreadsheet import DateText
from analysis.tables.table_files import FIRST_LINE, counted_lines, rows_of, shortened
from analysis.tables.words import NO, OURS, SUMMARY, YES, among, means, missing
from protocols.columns import COMMON_COLUMNS
from protocols.errors import StudyError, count_of, did_you_mean

LARGEST_WHOLE = 2**53
"""Beyond, tables of numbers do not tell neighbours apart."""
DAY_S = 86_400.0
BY_IMPORT = "metamerlab analysis import TABLE "
"""Command that tells columns and rows, for commands without --map and --where."""
_CODES = {99.0, 999.0, 9999.0, 99999.0, -9.0, -99.0, -999.0, -9999.0}
"""Codes of a missing number, where they lie far from all others."""
_RATING_CODES = {9.0, 77.0, 88.0, -1.0, *_CODES}


class Table:
    """A table as texts under our names, with what was left out or changed.

    Attributes
    ----------
    path : Path
        The user's file or folder.
    rows : DataFrame
        Texts. Of a file the index is the line minus 2.
    notes : list of str
        What was left out or changed; readers add to it.
    filtered, bounded : set of str, set of tuple of str
        Columns of conditions, and those with a bound of their own, with its ``<`` or ``>``.
    """

    def __init__(
        self,
        path: Path,
        mapping: Mapping[str, str] | None = None,
        where: Sequence[str] = (),
        answers: Mapping[str, str] | None = None,
        *,
        command: str = "",
        counted: Counted | None = None,
    ) -> None:
        """Read a table.

        Parameters
        ----------
        path : Path
            As `analysis.tables.table_files.rows_of` takes it.
        mapping : mapping of our name to the file's column
            ``COLUMN``, ``COLUMN:UNIT`` where its unit is another, or ``COLUMN+COLUMN`` where two
            make a name. Columns that already have our names need no entry.
        where : sequence of str
            Conditions such as ``contrast>0`` that every row must fulfil.
        answers : mapping
            What answers of the table are called in `expected`, or are to be called.
        command : str
            What stands before ``--map`` in cures, if it is no option of the command at hand.
        counted : {"choices", "answers"}, optional
            What a square table of counts counts; left out: such a table is none.

        Raises
        ------
        StudyError
            As `rows_of`; also for a column, unit, condition or answer that the table has not.
        """
        found = rows_of(path, counted)
        self.path, self.notes, self._command = path, found.notes, command
        self._places = found.lines if path.is_dir() else None
        lines = [line - FIRST_LINE for _, line in found.lines]
        index = list(range(len(lines))) if path.is_dir() else lines
        self.rows = pd.DataFrame(found.rows, columns=found.header, index=index, dtype=str)
        self._header = list(found.header)
        self._dates = {
            name: [index[k] for k, row in enumerate(found.rows) if isinstance(row[place], DateText)]
            for place, name in enumerate(found.header)
        }
        self._mapping: dict[str, str] = {}
        self.filtered: set[str] = set()
        self.bounded: set[tuple[str, str]] = set()
        self._source = self.rows
        self._units: dict[str, str] = {}  # of each column that was renamed, as said or taken
        self._refuse_doubled(mapping or {})
        for ours, theirs in (mapping or {}).items():
            self._rename(ours, theirs)
        # What was mapped is no other of our columns.
        self.rows = self.rows.drop(columns=list(self.renamed & OURS.keys()))
        for condition in where:
            self._filter(condition)
        if answers:
            self._call_answers(answers)
        self._without_summaries()
        if "participant" in self.rows:
            theirs = self.theirs("participant")
            self.notes += row_checks.shared_names(self.rows, self.cure("--map"), theirs)

    # Messages.

    def place(self, at: int) -> str:
        """Return file and line of a row."""
        file, line = self._places[at] if self._places else (self.path, at + FIRST_LINE)
        return f"{file}: line {line}"

    def refuse(
        self, wrong: pd.Series, must: str | Callable[[Any], str], got: pd.Series | None = None
    ) -> None:
        """Refuse the first row that is wrong: what must hold, or what its index says, and value."""
        if wrong.any():
            at = wrong.index[wrong][0]
            said = must if isinstance(must, str) else must(at)
            found = "" if got is None else f" (got {shortened(got[at])!r})"
            raise StudyError(f"{self.place(at)}: {said}{found}")

    def cure(self, words: str) -> str:
        """Return an option as the command at hand, or `analysis import`, takes it."""
        return f"{self._command}{words}"

    def need(self, missed: Sequence[str], cure: str = "") -> None:
        """Refuse a table without required columns, or those; the first word of each is its name."""
        every = [one.name for one in OURS.values() if one.required and one.name not in self.rows]
        if missed := list(dict.fromkeys([*every, *missed])):
            first, found = missed[0].split()[0], list(map(str, self.rows.columns))
            known = OURS.get(first)
            alike = [name for name in found if known is not None and means(name, known)]
            hint = f"; perhaps {alike[0]!r}?" if alike else did_you_mean(first, found)
            raise StudyError(
                f"{self.path}: must have the columns {', '.join(missed)}{cure}"
                f" (found: {', '.join(found)}); say which column holds it:"
                f" {self.cure('--map')} {first}=COLUMN{hint}"
            )

    @property
    def renamed(self) -> set[str]:
        """Columns of the user's table that are there under other names, too."""
        return set(self._mapping.values()) - self._mapping.keys()

    def theirs(self, ours: str) -> str:
        """Return the user's name of a column of ours."""
        return self._mapping.get(ours, ours)

    # Rows.

    def leave_out(self, out: pd.Series, why: str) -> None:
        """Leave rows out, and note how many and where."""
        lines = [
            f"{self._places[at][1]} of {self._places[at][0].name}" if self._places else at + 2
            for at in out.index[out]
        ]
        if lines:
            self.notes.append(f"left out{why}: {counted_lines(lines)}")
            self.rows = self.rows[~out]

    def only_main(self) -> None:
        """Leave out practice, catch trials and what exclusion rules left out."""
        for column, wanted, others in (
            ("kind", ("main",), ("practice", "catch")),
            ("included", ("1", "1.0"), ("0", "0.0")),
        ):
            if column not in self.rows:
                continue
            values = self.rows[column].str.strip()
            known = ", ".join(name for name in (*wanted, *others) if not name.endswith(".0"))
            must = f"{column} must be one of {known} (or the column have another name)"
            self.refuse(~values.isin((*wanted, *others)), must, values)
            for other in others:
                why = f", {other}" if column == "kind" else ", not included"
                self.leave_out(self.rows[column].str.strip() == other, why)

    @property
    def imported(self) -> bool:
        """True if all columns are of use, as an import keeps them; else one question's."""
        return self._command == BY_IMPORT

    def known(self, names: Collection[str | None], *, own: bool = False) -> None:
        """Refuse mapped names that the reader has no use for, and note columns that it has not.

        With `own` columns of the user's own are of use.
        """
        if own:
            return
        useful = {*filter(None, names), *self.filtered}
        for ours, theirs in self._mapping.items():
            if ours not in useful:
                listed = sorted(useful)
                raise StudyError(
                    f"--map {ours}={theirs}: must name one of {', '.join(listed)}"
                    f"{did_you_mean(ours, listed)}"
                )
        used = {*useful, *self._mapping.values(), *OURS, *COMMON_COLUMNS}
        spare = [name for name in self._header if name not in used and name]
        if spare:
            more = " ..." * (len(spare) > 5)
            self.notes.append(f"columns that were not used: {', '.join(spare[:5])}{more}")

    # Columns.

    def take(self, name: str, otherwise: object = None) -> Any:
        """Return a column of ours, checked as what it is declared; `otherwise` if there is none."""
        column = OURS[name]
        if name not in self.rows:
            return otherwise
        if column.kind == "text":
            return self.text(name)
        if column.kind == "0/1":
            return self.right() if name == "correct" else self.flag(name)
        if column.kind == "integer":
            return self.whole(name)
        return self.seconds(name) if column.unit == "s" else self.number(name)

    def text(self, column: str) -> pd.Series:
        """Return a column of names, none of them empty or spoilt by a spreadsheet."""
        values = self.rows[column].str.strip()
        self._refuse_cells(column, "a name", "text")
        self.refuse(values == "", f"{column} must not be empty")
        dates, all_of_them = row_checks.spoilt(values)
        if dates.any() and not all_of_them and column not in self.filtered:
            at = dates.index[dates][0]
            rows = count_of(int(dates.sum()), "row")
            self.refuse(
                dates,
                f"{column} must be a name, not the date that a spreadsheet made of one"
                f" (got {shortened(values[at])!r} in {rows}); write the name again"
                f" in a column of text, or {self.cure('--where')} '{column}!={values[at]}'",
            )
        if dates.any():
            self.notes.append(f"{column} holds dates, such as {values[dates].iloc[0]}: as names")
        for group in row_checks.look_alike(values.unique(), codes=column == "participant"):
            named = ", ".join(map(repr, group))
            self.notes.append(f"{column} {named} look alike: they count as {len(group)}")
        return values

    def _refuse_cells(self, column: str, wanted: str, kind: str) -> None:
        """Refuse a date or a time of a spreadsheet, and a list of several entries."""
        theirs = self.theirs(column)
        self.refuse(
            self.rows.index.to_series().isin(self._dates.get(theirs, [])),
            lambda at: (
                f"{column} must be {wanted}, not a date or a time (got {self.rows[column][at]!r} in"
                f" the spreadsheet's column {theirs!r}); format the column's cells as {kind} and"
                " write them again"
            ),
        )
        raw = self.rows[column].str.strip()
        lists = raw.str.fullmatch(r"\[.*,.*\]", na=False)
        self.refuse(
            lists,
            lambda at: (
                f"{column} must be one entry (got the list {shortened(raw[at])}, and"
                f" {int(lists.sum()) - 1} more); write in each one's place the entry that counts:"
                " the first, as PsychoPy does with Store: first key"
            ),
        )

    def number(self, column: str, *, rare: bool = False) -> pd.Series:
        """Return a column of finite numbers; what says missing is NaN.

        Codes such as 999 are refused, with `rare` (ratings) all rare values far from the others.
        """
        values = self._numbers(column)
        if column not in self.filtered:
            self._refuse_codes(column, values, rare=rare)
        self._refuse_unit(column, values)
        if not rare:
            self._refuse_odd(column, values)
        return values

    def _numbers(self, column: str) -> pd.Series:
        raw = self.rows[column].str.strip()
        self._refuse_cells(column, "a number", "numbers")
        values = pd.to_numeric(raw, errors="coerce").astype(float)
        self.refuse(
            ~missing(raw) & ~np.isfinite(values),
            lambda at: (
                f"{column} must be a number (got {shortened(raw[at])!r})"
                + column_units.cure(raw[at], self.cure(f"--map {column}={self.theirs(column)}"))
            ),
        )
        return values

    def whole(self, column: str) -> pd.Series:
        """Return a column of whole numbers from 0 on; what says missing is NaN."""
        values = self._numbers(column)
        wrong = (values != values.round()) & values.notna()
        wrong |= (values < 0) | (values > LARGEST_WHOLE)
        self.refuse(wrong, f"{column} must be a whole number from 0 on", self.rows[column])
        return values

    def order(self, people: pd.Series) -> pd.Series:
        """Return the column `order`, which no participant has twice in a session; else count."""
        if "order" not in self.rows:
            return people.groupby(people).cumcount() + 1
        order = self.whole("order")
        session = self.rows.get("session", people)
        twice = pd.DataFrame({"who": people, "session": session, "order": order}).duplicated()
        self.refuse(
            twice & order.notna(),
            lambda at: (
                "order must not come twice for a participant"
                f" (got {order[at]:g} again for {people[at]!r}); were rows pasted twice? Leave"
                " order out if rows are in order"
            ),
        )
        return order

    def flag(self, column: str) -> pd.Series:
        """Return a column of 1 and 0, or yes and no in words."""
        raw = self.rows[column]
        good, bad = among(raw, YES), among(raw, NO)
        cure = f"; leave such rows out with {self.cure('--where')} '{column}!={{}}'"
        if column == "correct":
            cure += f", or, if it holds the right answer, {self.cure('--map expected=COLUMN')}"
            cure += " --map answer=COLUMN"
        must = f"{column} must be 1 or 0 (got {{!r}}){cure}"
        self.refuse(~good & ~bad, lambda at: must.format(shortened(raw[at]), shortened(raw[at])))
        return good.astype("int64")

    def right(self) -> pd.Series:
        """Return the column `correct`; words that are the question's answers too are refused."""
        values = self.flag("correct")
        said = set(self.rows["correct"].str.strip().str.casefold()) - {"1", "0", "1.0", "0.0"}
        if said <= {"true", "false", "t", "f", "correct", "incorrect", "wrong", "right"}:
            return values
        theirs = self.theirs("correct")
        for name in self._header:
            if name not in self.rows or not means(name, OURS["answer"]):
                continue
            if set(self.rows[name].str.strip().str.casefold()) & said:
                raise StudyError(
                    f"{self.path}: correct must say whether answers were right ({theirs} holds"
                    f" {', '.join(sorted(said))}, as {name} does); if it is the right answer,"
                    f" {self.cure(f'--map expected={theirs}')} --map answer={name}"
                )
        self.notes.append(f"{theirs} says {' and '.join(sorted(said))}: read as right and wrong")
        return values

    def seconds(self, column: str = "rt_s") -> pd.Series:
        """Return a column of durations above 0 and below a day; what says missing is NaN."""
        values = self._numbers(column)
        if self._likely("s", column, values):
            self._refuse_unit(column, values)
        must = (
            f"{column} must be above 0 seconds and below a day (got {{}}); leave such rows out with"
        )
        raw = self.rows[column].map(lambda one: repr(shortened(one)))
        wrong = (values <= 0) | (values >= DAY_S)
        kept = values.map(lambda one: f"<{DAY_S:g}" if one > 0 else ">0")
        where = f"{self.cure('--where')} '{column}"
        self.refuse(wrong, lambda at: f"{must.format(raw[at])} {where}{kept[at]}'")
        if "participant" in self.rows:
            self._refuse_unit(column, values, self.rows["participant"].str.strip())
        return self.number(column)

    # How the table is made.

    def _rename(self, ours: str, text: str) -> None:
        header = list(map(str, self._source.columns))
        base = column_units.unit_of(OURS.get(ours), ours)
        theirs, unit = column_units.split_unit(text, header, base, f"--map {ours}={text}")
        parts = theirs.split("+")
        if theirs not in header and set(parts) <= set(header):
            joined = self._source[parts].agg("-".join, axis=1)
            self._source = self._source.assign(**{theirs: joined})
        elif theirs not in header:
            raise StudyError(
                f"{self.path}: must have the column {theirs!r} mapped to {ours}"
                f" (found: {', '.join(header)}){did_you_mean(theirs, header)}"
            )
        values = self._source[theirs]
        if unit is None and ours != theirs:
            unit = column_units.said_by(theirs, base)
            if unit not in (None, base, "right"):
                self.notes.append(f"{theirs} read in {unit}, as its name says")
        if unit == "percent":
            must = f"{theirs} must have % in all cells or in none"
            self.refuse(column_units.no_percent(values), must, values)
        self.rows = self.rows.assign(
            **{ours: values if unit is None else column_units.converted(values, unit)}
        )
        self._mapping[ours] = theirs
        self._units[ours] = unit or base

    def _filter(self, condition: str) -> None:
        """Keep the rows of which a condition is true."""
        option = f"--where {condition}"
        found = row_checks.CONDITION.fullmatch(condition)
        if found is None:
            raise StudyError(f"{option}: must read COLUMN>0, or with =, !=, <, <=, >=")
        name, sign, wanted = found.groups()
        if name not in self.rows:
            listed = list(map(str, self.rows.columns))
            raise StudyError(
                f"{option}: must name a column of the table ({', '.join(listed)})"
                f"{did_you_mean(name, listed)}"
            )
        kept = row_checks.kept(self.rows[name], sign, wanted)
        if isinstance(kept, str):
            raise StudyError(f"{option}: must compare numbers (got {shortened(kept)!r})")
        if not kept.any():
            some = sorted(set(self.rows[name].str.strip()))
            raise StudyError(
                f"{option}: must leave a row ({name} holds {', '.join(some[:8])}"
                f"{' ...' * (len(some) > 8)}){did_you_mean(wanted, some)}"
            )
        self.filtered.add(name)
        if wanted not in ("0", "none"):
            self.bounded.add((name, sign[0]))
        if kept.all():
            self.notes.append(f"{option} leaves no row out")
        self.leave_out(~kept, f" by {option}")

    def _call_answers(self, answers: Mapping[str, str]) -> None:
        """Give answers other names."""
        name = next((one for one in ("answer", "chosen", "rating") if one in self.rows), None)
        if name is None:
            self.need(["answer"])
        values = self.rows[str(name)].str.strip()
        for theirs in answers:
            if not (values == theirs).any():
                held = sorted(set(values[~missing(values)]))
                raise StudyError(
                    f"--answer {theirs}={answers[theirs]}: must be an answer that the column"
                    f" {name} holds ({', '.join(held[:8])}){did_you_mean(theirs, held)}"
                )
        self.rows = self.rows.assign(**{str(name): values.replace(dict(answers))})

    def _without_summaries(self) -> None:
        """Leave out rows with a mean or a sum in the place of a participant."""
        rows = self.rows
        if "participant" not in rows:
            return
        who = rows["participant"].str.strip()
        out = who.map(lambda one: SUMMARY.fullmatch(one) is not None).astype(bool)
        for name in rows.columns if (who == "").any() else ():
            said = rows[name][who == ""].str.strip()
            out[said.index] |= said.map(lambda one: SUMMARY.fullmatch(one) is not None)
        if not out.all():
            self.leave_out(out, ", summary of others")

    def _refuse_doubled(self, mapping: Mapping[str, str]) -> None:
        rows = self.rows
        if (who := mapping.get("participant", "")) in rows and "participant" not in rows:
            rows = rows.assign(participant=rows[who])
        places = row_checks.doubled(rows)
        if places is not None:
            first, second = map(self.place, places)
            raise StudyError(
                f"{second}: must not repeat other rows (from here on they are those from"
                f" {first.rpartition('line ')[2]} on); delete what was pasted twice"
            )

    def _refuse_codes(self, column: str, values: pd.Series, *, rare: bool) -> None:
        known = values.dropna()
        codes = _RATING_CODES if rare else _CODES
        suspects = known.isin(codes)
        if rare:
            suspects |= known.map(known.value_counts()) <= 0.1 * len(known)
        rest = known[~suspects]
        if rest.nunique() < 2:
            return
        least, most = float(rest.min()), float(rest.max())
        reach = (0.75 if rare else 3.0) * (most - least)
        far = suspects & ((known > most + reach) | (known < least - reach))
        if rare:
            far |= suspects & (known < 0) & (least >= 0)
            far &= known.isin(codes) | (known > most + 3 * (most - least))
        if far.any():
            code = float(known[far].iloc[0])
            rows = count_of(int((known == code).sum()), "row")
            raise StudyError(
                f"{self.place(far.index[far][0])}: {column} must be a value like the others, from"
                f" {least:g} to {most:g} (got {code:g} in {rows}); leave"
                f" it out with {self.cure('--where')} '{column}!={code:g}', or, if it is meant, say"
                f" --where '{column}{'<=' if code > most else '>='}{code:g}'"
            )

    def _refuse_odd(self, column: str, values: pd.Series) -> None:
        """Refuse one number that is in another unit than the others, unless a bound was given."""
        base = column_units.unit_of(OURS.get(column), column)
        texts = self._source[self.theirs(column)][values.index]
        found = column_units.odd_one(column, base, values, texts)
        if found is None:
            return
        at, must, cure, large = found
        sign = "<" if large else ">"
        if (column, sign) in self.bounded:
            return
        bound = values.max() if large else values.min()
        raise StudyError(
            f"{self.place(at)}: {column} {must} (got {shortened(texts[at])!r}); {cure}, or leave"
            f" such rows out with {self.cure('--where')} '{column}!={values[at]:.12g}'; if it is"
            f" meant, say --where '{column}{sign}={bound:.12g}'"
        )

    def _likely(self, base: str, column: str, values: pd.Series) -> Sequence[str]:
        """Return units in which the user's own numbers, whatever was said of them, are possible."""
        factor = column_units.UNITS.get(base, {}).get(self._units.get(column, base), 1.0)
        return column_units.likely(base, values / factor)

    def _refuse_unit(self, column: str, values: pd.Series, people: pd.Series | None = None) -> None:
        base = column_units.unit_of(OURS.get(column), column)
        wrong = column_units.impossible(column, base, values, people)
        if not wrong:
            return
        theirs, others = self.theirs(column), self._likely(base, column, values)
        if people is not None:
            cure = "bring all people's to one unit, or leave these out with"
            cure = f"{cure} {self.cure('--where')} 'participant!=CODE'"
        elif others:
            cure = f"say its unit: {self.cure('--map')} {column}={theirs}:{others[0]}"
        else:
            named = f"{column.rpartition('_')[0] or column}_px={theirs}"
            cure = (
                f"say its unit, {self.cure('--map')} {column}={theirs}:UNIT, or call it by another"
            )
            cure = f"{cure}, such as --map {named}"
        raise StudyError(f"{self.path}: {wrong}; {cure}")


Source = str | Path | Table
"""A table, or where it lies."""


def opened(source: Source) -> Table:
    """Return the table; one that lies in a file is read."""
    return source if isinstance(source, Table) else Table(Path(source))
