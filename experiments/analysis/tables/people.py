"""Who took part: Table 2 (what they were asked at registration, with what they said) and the table
of participants.
"""

import math
from collections.abc import Collection, Iterator, Sequence

from experiments.analysis.statistics.descriptive import ROUNDED, shares, spread
from experiments.analysis.tables.response_selection import counted, note
from experiments.analysis.tables.table import Table, TableCell, amount, count, number, words
from experiments.dataset.counting import visits_of
from experiments.dataset.levels import WITHHELD
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
HEAD = ("Question", "Answer", "n", "%")
Row = tuple[TableCell, ...]


def table_2(dataset: Dataset) -> Table:
    """Return what participants were asked at registration, and how often each answer was given."""
    responses = counted(dataset, dataset.registration)
    definition = dataset.questionnaire(dataset.registration)
    rows = [
        row
        for question in (definition.questions() if definition else ())
        for row in _question_rows(dataset, question, responses)
    ]
    return Table(
        "table-2",
        "Questions for visitor registration, and what was answered.",
        HEAD,
        tuple(rows),
        (note(dataset, responses),),
    )


def participants_table(dataset: Dataset) -> Table:
    """Return how many took part, their ages and, of questions with options or a scale, how many
    gave each answer.
    """
    people = dataset.included
    responses = counted(dataset, dataset.registration) if dataset.registration else []
    registered = (
        {one.participant for one in responses}
        if dataset.registration
        else {one.id for one in people}
    )
    drivers = {one.participant for one in dataset.sessions}
    visits = visits_of(dataset.sessions)
    returned = {one.participant for one in dataset.sessions if visits[one.id] > 1}
    groups = [("registered", registered), ("drove a robot", drivers), ("came back", returned)]
    parts = [100.0 * len(ids) / len(registered) if registered else None for _, ids in groups]
    rows = [
        *_group_rows(dataset, "Participants", groups, parts),
        *_age_rows(dataset, [one for one in people if one.id in registered]),
    ]
    definition = dataset.questionnaire(dataset.registration)
    for question in definition.questions() if definition else ():
        if question.labelled_values and not question.item.takes_several:
            rows += _question_rows(dataset, question, responses)
    below = (
        f"{amount(len(people), 'participant')}, {amount(len(dataset.sessions), 'session')}. came"
        " back: drove, in drives that count, on more than one visit."
    )
    return Table("participants", "Participants.", ("", "", "n", "%"), tuple(rows), (below, ROUNDED))


def _group_rows(
    dataset: Dataset,
    head: str,
    groups: Sequence[tuple[str, Collection[str]]],
    parts: Sequence[float | None],
) -> Iterator[Row]:
    """Yield a row for each group of participants, with its share in percent."""
    for (label, ids), part in zip(groups, parts, strict=True):
        found = count(len(ids), dataset.sessions_of(ids))
        yield words(head), words(label), found, number(part, 1)
        head = ""


def _age_rows(dataset: Dataset, people: Sequence[ParticipantRecord]) -> Iterator[Row]:
    known = {one.id: one.age for one in people if not math.isnan(one.age)}
    groups = [
        (label, [who for who, age in known.items() if low <= age < high])
        for low, high, label in AGES
    ]
    groups.append((NOT_REPORTED, [one.id for one in people if one.id not in known]))
    parts = shares([len(ids) for _, ids in groups]) or (None,) * len(groups)
    yield from _group_rows(dataset, "Age", groups, parts)
    ages, about = sorted(known.values()), dataset.sessions_of(known)
    bounds = (ages[0], spread(ages).median, ages[-1]) if ages else (None, None, None)
    for label, value in zip(("youngest", "median", "oldest"), bounds, strict=True):
        yield words(""), words(label), number(value, 0, about), words("")


def _question_rows(
    dataset: Dataset, question: Question, responses: Sequence[ResponseRecord]
) -> Iterator[Row]:
    """Yield a row for each answer to a question with options or a scale, or one of those who
    answered; then those to whom it does not apply, and those who gave no answer.
    """
    key = question.key
    given = {one.participant: one.values.get(key) for one in responses}
    reasons = {one.participant: one.missing.get(key) for one in responses}
    silent = [who for who, said in given.items() if said is None]
    groups = [
        (label, [who for who, said in given.items() if _says(question, said, value)])
        for value, label in _options(dataset, question)
    ]
    if not groups:
        withheld = [who for who in silent if reasons[who] == WITHHELD]
        groups = [("answered", [*(who for who in given if who not in silent), *withheld])]
        silent = [who for who in silent if who not in withheld]
    if question.item.not_applicable:
        declined = [who for who in silent if reasons[who] == Missing.NOT_APPLICABLE]
        groups.append((DOES_NOT_APPLY, declined))
        silent = [who for who in silent if who not in declined]
    groups.append((NOT_REPORTED, silent))
    parts: Sequence[float | None] = [
        100.0 * len(ids) / len(given) if given else None for _, ids in groups
    ]
    if not question.item.takes_several:
        parts = shares([len(ids) for _, ids in groups]) or parts
    yield from _group_rows(dataset, dataset.say(question.text), groups, parts)


def _options(dataset: Dataset, question: Question) -> list[tuple[str | int, str]]:
    return [(value, dataset.say(label) or str(value)) for value, label in question.labelled_values]


def _says(question: Question, said: object, value: str | int) -> bool:
    compared = None if said is None else question.item.compared(said)
    return value in compared if isinstance(compared, list) else compared == value
