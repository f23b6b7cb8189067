"""Who took part: Table 2, the table of participants, and notes on pilots and bots."""

import math
import statistics
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

from experiments.analysis.statistics.descriptive import ROUNDED
from experiments.analysis.tables.scored_responses import counted, note
from experiments.analysis.tables.table import Table, amount, number, people_count
from experiments.dataset.counting import visits_of
from experiments.dataset.levels import KINDS, WITHHELD, Kind
from experiments.dataset.records import Dataset, ParticipantRecord, ResponseRecord
from surveys.answers import Missing
from surveys.item import Question

AGES = (
    (-math.inf, 15.0, "younger than 15"),
    (15.0, 30.0, "15–29"),
    (30.0, 45.0, "30–44"),
    (45.0, 60.0, "45–59"),
    (60.0, math.inf, "60 and older"),
)
NOT_REPORTED = "not reported"
DOES_NOT_APPLY = "does not apply"
COUNTED = "with a drive that counts"
HEAD = ("Question", "Answer", "n", "%")
TITLES = {"bot": "simulated participants (bots)"}  # of other kinds the plural
BOTS = "bots are programs that took part in place of people"
People = tuple[str, Collection[str]]  # a label, and the participants that it names
Rows = Iterator[tuple[object, ...]]


def table_2(dataset: Dataset) -> Table:
    """Return the questions of the registration, and how often each answer was given."""
    responses = counted(dataset, dataset.registration)
    rows: list[tuple[object, ...]] = []
    for question in _registration(dataset):
        groups, whole = answer_groups(dataset, question, responses)
        rows += _group_rows(dataset, dataset.say(question.text), groups, whole)
    title = "Questions for visitor registration, and what was answered."
    return Table.of("table-2", title, HEAD, rows, (note(dataset, responses),))


def _registration(dataset: Dataset) -> Iterable[Question]:
    definition = dataset.questionnaire(dataset.registration)
    return definition.questions() if definition else ()


def participants_table(dataset: Dataset) -> Table:
    """Return who took part, both of everybody and of those whose drives the results have."""
    people, responses = dataset.included, list[ResponseRecord]()
    registered = {one.id for one in people}
    if dataset.registration:
        responses = counted(dataset, dataset.registration)
        registered = {one.participant for one in responses}
    drivers = {one.participant for one in dataset.sessions}
    visits = visits_of(dataset.sessions)
    returned = {one.participant for one in dataset.sessions if visits[one.id] > 1}
    groups: list[People] = [("registered", registered), (COUNTED, drivers), ("came back", returned)]
    rows = list(_group_rows(dataset, "Participants", groups, registered | drivers, drivers))
    ages = {one.id: one.age for one in people if one.id in registered | drivers}
    rows += _age_rows(dataset, ages, drivers)
    for question in _registration(dataset):
        if question.labelled_values and not question.item.takes_several:
            groups, whole = answer_groups(dataset, question, responses)
            text = dataset.say(question.text)
            rows += _group_rows(dataset, text, groups, whole, drivers & {*whole})
    below = (
        f"{amount(len(people), 'participant')}, {amount(len(dataset.sessions), 'session')}."
        f" Results: those {COUNTED}. All: everybody who registered or has such a drive, without"
        " those who withdrew or are excluded by a rule of the plan. came back: drove, in drives"
        " that count, on more than one visit."
    )
    head = ("", "", "All: n", "All: %", "Results: n", "Results: %")
    return Table.of("participants", "Participants.", head, rows, (below, ROUNDED))


def _group_rows(
    dataset: Dataset, head: str, groups: Sequence[People], *wholes: Collection[str]
) -> Rows:
    """Yield the number and the percentage of each group among some participants, or several."""
    for label, ids in groups:
        cells: list[object] = []
        for whole in wholes:
            own = [who for who in ids if who in whole]
            share = number(100.0 * len(own) / len(whole) if whole else None, 1)
            cells += [people_count(dataset, own), share]
        yield head, label, *cells
        head = ""


def _age_rows(dataset: Dataset, ages: Mapping[str, float], drivers: Collection[str]) -> Rows:
    """Yield the ages of participants, NaN where unknown, and of the drivers among them."""
    groups: list[People] = [
        (label, [who for who, age in ages.items() if low <= age < high])
        for low, high, label in AGES
    ]
    groups.append((NOT_REPORTED, [who for who, age in ages.items() if math.isnan(age)]))
    both = [[*ages], [who for who in ages if who in drivers]]
    yield from _group_rows(dataset, "Age", groups, *both)
    known = [{who: ages[who] for who in some if not math.isnan(ages[who])} for some in both]
    bounds: dict[str, Callable[[Iterable[float]], float]]
    bounds = {"youngest": min, "median": statistics.median, "oldest": max}
    for label, bound in bounds.items():
        found = ((bound(it.values()) if it else None, dataset.sessions_of(it)) for it in known)
        yield "", label, *chain.from_iterable((number(age, 0, ids), "") for age, ids in found)


def answer_groups(
    dataset: Dataset, question: Question, responses: Sequence[ResponseRecord]
) -> tuple[list[People], Collection[str]]:
    """Return who gave each answer to a question with options or a scale, or who answered; then to
    whom it does not apply, and who gave no answer. Second, the participants to count these among.
    """
    key = question.key
    given = {one.participant: one.values.get(key) for one in responses}
    reasons = {one.participant: one.missing.get(key) for one in responses}
    unanswered = [who for who, answer in given.items() if answer is None]
    groups: list[People] = []
    for value, label in question.labelled_values:
        having = [who for who, answer in given.items() if _has(question, answer, value)]
        groups.append((dataset.say(label) or str(value), having))
    if not groups:
        withheld = [who for who in unanswered if reasons[who] == WITHHELD]
        groups = [("answered", [*(who for who in given if who not in unanswered), *withheld])]
        unanswered = [who for who in unanswered if who not in withheld]
    if question.item.not_applicable:
        declined = [who for who in unanswered if reasons[who] == Missing.NOT_APPLICABLE]
        groups.append((DOES_NOT_APPLY, declined))
        unanswered = [who for who in unanswered if who not in declined]
    groups.append((NOT_REPORTED, unanswered))
    named = {who for _, ids in groups for who in ids}
    return groups, given if question.item.takes_several else named


def _has(question: Question, answer: object, value: str | int) -> bool:
    compared = None if answer is None else question.item.compared(answer)
    return value in compared if isinstance(compared, list) else compared == value


# --- pilots and bots ------------------------------------------------------------------------------


def counted_by_kind(people: Sequence[ParticipantRecord], *always: Kind) -> str:
    """Return `0 participants, 24 bots`: kinds that took part, and those in `always`."""
    found = Counter[str](one.kind for one in people)
    named = [kind for kind in KINDS if found[kind] or kind in always]
    return ", ".join(amount(found[kind], kind) for kind in named)


def title_of(people: Sequence[ParticipantRecord]) -> str:
    """Return whose results these are; empty where they are those of participants alone."""
    found = {one.kind for one in people}
    if found <= {"participant"}:
        return ""
    title = " and ".join(TITLES.get(kind, f"{kind}s") for kind in KINDS if kind in found)
    return f"{title[0].upper()}{title[1:]}"


def kinds_note(people: Sequence[ParticipantRecord]) -> str:
    """Return who is meant by participants; empty where they are participants alone."""
    if not title_of(people):
        return ""
    more = f"; {BOTS}" if any(one.kind == "bot" for one in people) else ""
    return f"“Participants” are {counted_by_kind(people)} here{more}."


def label_kinds(table: Table, people: Sequence[ParticipantRecord]) -> Table:
    """Return a table that says whose results it has: it may be copied out of its report."""
    title = title_of(people)
    if not title:
        return table
    notes = (kinds_note(people), *table.notes)
    return replace(table, title=f"{title}: {table.title}", notes=notes)
