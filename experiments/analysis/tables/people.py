"""Who took part: Table 2 (what they were asked at registration, with what they said) and the table
of participants.
"""

import math
from collections.abc import Collection, Iterator, Sequence

from experiments.analysis.dataset.counting import visits_of
from experiments.analysis.dataset.levels import WITHHELD
from experiments.analysis.dataset.records import Dataset, ParticipantRecord, ResponseRecord
from experiments.analysis.statistics.descriptive import ROUNDED, shares, spread
from experiments.analysis.tables.response_selection import counted, note
from experiments.analysis.tables.table import Table, TableCell, amount, count, number, words
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
    total = len(registered)
    rows = [
        _row(dataset, "Participants", "registered", registered, total),
        _row(dataset, "", "drove a robot", drivers, total),
        _row(dataset, "", "came back", returned, total),
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


def _age_rows(dataset: Dataset, people: Sequence[ParticipantRecord]) -> Iterator[Row]:
    members = [
        (label, [one.id for one in people if low <= one.age < high]) for low, high, label in AGES
    ]
    members.append((NOT_REPORTED, [one.id for one in people if math.isnan(one.age)]))
    parts = shares([len(ids) for _, ids in members]) or (None,) * len(members)
    for index, ((label, ids), part) in enumerate(zip(members, parts, strict=True)):
        yield (
            words("" if index else "Age"),
            words(label),
            count(len(ids), dataset.sessions_of(ids)),
            number(part, 1),
        )
    known = {one.id: one.age for one in people if not math.isnan(one.age)}
    about = dataset.sessions_of(known)
    bounds = (
        (min(known.values()), spread(list(known.values())).median, max(known.values()))
        if known
        else (None, None, None)
    )
    for label, value in zip(("youngest", "median", "oldest"), bounds, strict=True):
        yield words(""), words(label), number(value, 0, about), words("")


def _row(dataset: Dataset, head: str, label: str, ids: Collection[str], total: int) -> Row:
    share = 100.0 * len(ids) / total if total else None
    return words(head), words(label), count(len(ids), dataset.sessions_of(ids)), number(share, 1)


def _question_rows(
    dataset: Dataset, question: Question, responses: Sequence[ResponseRecord]
) -> Iterator[Row]:
    """A question with options or a scale has a row each; another one has how many answered it. Who
    gave none stands in a row of its own, and so do those to whom it does not apply.
    """
    given = {one.participant: one.values.get(question.key) for one in responses}
    options = _options(dataset, question)
    groups = [
        (label, [who for who, said in given.items() if _says(question, said, value)])
        for value, label in options
    ]
    if not options:
        withheld = {
            one.participant for one in responses if one.missing.get(question.key) == WITHHELD
        }
        given |= dict.fromkeys(withheld, WITHHELD)
        groups = [("answered", [who for who, said in given.items() if said is not None])]
    silent = [who for who, said in given.items() if said is None]
    declined = {
        one.participant
        for one in responses
        if one.missing.get(question.key) == Missing.NOT_APPLICABLE
    }
    if question.item.not_applicable:
        groups.append((DOES_NOT_APPLY, [who for who in silent if who in declined]))
        silent = [who for who in silent if who not in declined]
    groups.append((NOT_REPORTED, silent))
    parts = None if question.item.takes_several else shares([len(ids) for _, ids in groups])
    for index, (label, ids) in enumerate(groups):
        share = parts[index] if parts else 100.0 * len(ids) / len(given) if given else None
        head = dataset.say(question.text) if not index else ""
        yield words(head), words(label), count(len(ids), dataset.sessions_of(ids)), number(share, 1)


def _options(dataset: Dataset, question: Question) -> list[tuple[str | int, str]]:
    return [(value, dataset.say(label) or str(value)) for value, label in question.labelled_values]


def _says(question: Question, said: object, value: str | int) -> bool:
    compared = None if said is None else question.item.compared(said)
    return value in compared if isinstance(compared, list) else compared == value
