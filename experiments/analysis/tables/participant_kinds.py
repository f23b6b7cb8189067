"""Whose results a report has. One on pilots or bots says so in each title, note and figure: a table
that is copied out of it is read without the rest (figures/drawing.py draws it).
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

from experiments.analysis.tables.table import Table, amount
from experiments.dataset.levels import Kind
from experiments.dataset.records import ParticipantRecord

KINDS: tuple[Kind, ...] = get_args(Kind)
TITLES: dict[Kind, str] = {
    "participant": "participants",
    "pilot": "pilots",
    "bot": "simulated participants (bots)",
}
BOTS = "bots are programs that took part in place of people"


def counted(people: Sequence[ParticipantRecord], *always: Kind) -> str:
    """Return how many there are of each kind, `0 participants, 24 bots`: of those that are
    there, and of those that are always named.
    """
    found = Counter(one.kind for one in people)
    named = [kind for kind in KINDS if found[kind] or kind in always]
    return ", ".join(amount(found[kind], kind) for kind in named)


def title_of(people: Sequence[ParticipantRecord]) -> str:
    """Return whose results these are; empty where they are those of participants alone."""
    found = {one.kind for one in people}
    if found <= {"participant"}:
        return ""
    title = " and ".join(TITLES[kind] for kind in KINDS if kind in found)
    return f"{title[0].upper()}{title[1:]}"


def note_of(people: Sequence[ParticipantRecord]) -> str:
    """Return who is meant by participants here; empty where nothing is to be said."""
    if not title_of(people):
        return ""
    more = f"; {BOTS}" if any(one.kind == "bot" for one in people) else ""
    return f"“Participants” are {counted(people)} here{more}."


def of_whom(table: Table, people: Sequence[ParticipantRecord]) -> Table:
    """Return a table that says whose results it has."""
    title = title_of(people)
    if not title:
        return table
    notes = (note_of(people), *table.notes)
    return replace(table, title=f"{title}: {table.title}", notes=notes)
