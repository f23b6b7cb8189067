"""Where participants went: the flow from arriving to answering, with reasons for every loss, and
the funnel page by page.

Four facts are kept apart: assigned, exposed (the first velocity moved the robot), how the task
ended, and answered. Nobody is lost from the flow: each line is the one above it less those who are
named between.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from experiments.analysis.dataset.records import (
    COMPLETED,
    Dataset,
    ParticipantRecord,
    SessionRecord,
)
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.descriptive import spread
from experiments.analysis.tables.table import (
    Table,
    TableCell,
    amount,
    count,
    number,
    spoken,
    words,
)

COUNTED = "ended with an outcome"
FLOW = ("arrived", "assigned", "exposed", COUNTED, "answered")
STILL_THERE = "not continued (yet)"
Row = tuple[TableCell, ...]


def flow(dataset: Dataset) -> Table:
    """Return how many participants came how far, why the others did not, and how the tasks of each
    condition ended.
    """
    rows = _stages(dataset, list(dataset.participants), "all")
    cells = list(dict.fromkeys(one.cell for one in dataset.participants if one.cell))
    for cell in cells if len(cells) > 1 else ():
        rows += _stages(dataset, [one for one in dataset.participants if one.cell == cell], cell)[
            1:
        ]
    below = (
        (
            "Every line is the one above it minus the participants named in between; withdrawn"
            " participants are counted at the last step they reached."
        ),
        *_about_ruled_out(dataset),
    )
    return Table(
        "flow",
        "Flow of participants.",
        ("Condition", "Stage", "Reason", "Participants"),
        tuple(rows),
        below,
    )


def _about_ruled_out(dataset: Dataset) -> Iterator[str]:
    reasons = Counter(one.ruled_out for one in dataset.ruled_out)
    for reason, number_ in sorted(reasons.items()):
        yield (
            f"Excluded by rule, because the platform ended them: {amount(number_, 'session')}"
            f" ({reason}). They count in no other table or figure."
        )


def _stages(dataset: Dataset, people: list[ParticipantRecord], cell: str) -> list[Row]:
    sessions = {
        one.id: [session for session in dataset.sessions if session.participant == one.id]
        for one in people
    }
    answered = {
        one.participant
        for one in dataset.responses
        if one.questionnaire == dataset.study.analysis.statements and one.finished
    }
    ruled_out = {
        one.id: [session for session in dataset.ruled_out if session.participant == one.id]
        for one in people
    }
    tests: tuple[Callable[[ParticipantRecord], bool], ...] = (
        lambda _: True,
        lambda one: bool(one.cell or sessions[one.id] or ruled_out[one.id]),
        lambda one: any(session.exposed for session in (*sessions[one.id], *ruled_out[one.id])),
        lambda one: any(session.exposed and session.outcome for session in sessions[one.id]),
        lambda one: one.id in answered,
    )
    rows: list[Row] = []
    left = people
    for stage, reached in zip(FLOW, tests, strict=True):
        lost = [one for one in left if not reached(one)]
        left = [one for one in left if reached(one)]
        reasons = {
            one.id: _excluded(ruled_out[one.id])
            if stage == COUNTED and ruled_out[one.id]
            else f"left: {_reason(one)}"
            for one in lost
        }
        for reason, number_ in sorted(Counter(reasons.values()).items()):
            ids = [one.id for one in lost if reasons[one.id] == reason]
            rows.append(
                (
                    words(cell),
                    words(""),
                    words(reason),
                    count(number_, dataset.sessions_of(ids)),
                )
            )
        rows.append(
            (
                words(cell),
                words(stage),
                words(""),
                count(len(left), dataset.sessions_of([one.id for one in left])),
            )
        )
        if stage == COUNTED:
            rows += _outcomes(dataset, left, cell)
    return rows


def _outcomes(dataset: Dataset, people: list[ParticipantRecord], cell: str) -> list[Row]:
    """How their first tasks ended."""
    known = {one.id for one in people}
    first: dict[str, tuple[str, str]] = {}
    for one in sorted(
        (one for one in dataset.sessions if one.exposed and one.outcome), key=lambda one: one.number
    ):
        if one.participant in known:
            first.setdefault(one.participant, (one.outcome, one.id))
    words_found = sorted({outcome for outcome, _ in first.values()})
    return [
        (words(cell), words(""), words(f"first task: {spoken(word)}"), count(len(ids), ids))
        for word in words_found
        for ids in [[one for outcome, one in first.values() if outcome == word]]
    ]


def _excluded(ruled_out: Sequence[SessionRecord]) -> str:
    return f"excluded: {ruled_out[-1].ruled_out}"


def _reason(one: ParticipantRecord) -> str:
    return "withdrew" if one.withdrawn else spoken(one.left) or STILL_THERE


def fault_sides(dataset: Dataset) -> Table:
    """Return on which side it lay that sessions were not completed, by outcome; with those that are
    excluded by rule.
    """
    ended = [
        one for one in (*dataset.sessions, *dataset.ruled_out) if one.outcome not in {"", COMPLETED}
    ]
    keys = sorted({(one.outcome, one.fault_side) for one in ended})
    rows = tuple(
        (words(spoken(outcome)), words(side or "nobody"), count(len(ids), ids))
        for outcome, side in keys
        for ids in [[one.id for one in ended if (one.outcome, one.fault_side) == (outcome, side)]]
    )
    below = (
        "Platform: the server was unavailable when the connection was lost; network: the"
        " connection was lost, and the visitor had not closed the page."
    )
    return Table(
        "fault-sides",
        "Sessions that were not completed, by side.",
        ("Outcome", "Side", "Sessions"),
        rows,
        (below,),
    )


def funnel(dataset: Dataset, measured: Sequence[Measured]) -> Table:
    """Return a line a page and milestone: how many came, how many went on, and the median of the
    seconds that it took.
    """
    study = dataset.study
    task = next((index for index, step in enumerate(study.steps) if step is study.task), None)
    steps = [step.key for step in dataset.study.steps]
    extra = [key for key in dict.fromkeys(page.step for page in dataset.pages) if key not in steps]
    rows = [
        _page_row(dataset, key) for key in (*extra, *steps[: task if task is None else task + 1])
    ]
    rows += _milestone_rows(dataset, measured)
    rows += [_page_row(dataset, key) for key in steps[len(steps) if task is None else task + 1 :]]
    people, sessions = len(dataset.participants), len(dataset.sessions)
    below = (
        f"{amount(people, 'participant')}, {amount(sessions, 'session')}. Pages are counted by"
        " participant, milestones by session."
    )
    return Table(
        "funnel",
        "Funnel.",
        ("Page or milestone", "Came", "Went on", "Left", "Median (s)"),
        tuple(rows),
        (below,),
    )


def _page_row(dataset: Dataset, key: str) -> Row:
    pages = [page for page in dataset.pages if page.step == key]
    came = {page.participant for page in pages}
    went = {page.participant for page in pages if page.finished}
    stayed = sorted(came - went)
    seconds = spread([page.seconds for page in pages if page.finished]).median
    cells = (
        count(len(came), dataset.sessions_of(came)),
        count(len(went), dataset.sessions_of(went)),
        count(len(stayed), dataset.sessions_of(stayed)),
    )
    return words(_title(dataset, key)), *cells, number(seconds, 1)


def _title(dataset: Dataset, key: str) -> str:
    return next((dataset.say(step.title) for step in dataset.study.steps if step.key == key), key)


def _milestone_rows(dataset: Dataset, measured: Sequence[Measured]) -> list[Row]:
    """Each milestone with the seconds since the one before it, of the sessions
    that reached both.
    """
    numbers = sorted(
        {
            stop.number
            for course in dataset.study.courses
            for stop in course.checkpoints
            if stop.number > 0
        }
    )
    times: list[tuple[str, Callable[[Measured], float]]] = [
        ("first video frame", lambda one: one.milestones.start),
        ("first motion", lambda one: one.milestones.motion),
        *((f"checkpoint {n}", _passing(n)) for n in numbers),
        ("docked", lambda one: one.milestones.docked),
    ]
    rows: list[Row] = []
    came = list(measured)
    before: Callable[[Measured], float] = lambda _: 0.0  # noqa: E731 -- one of several of its kind
    for label, when in times:
        went = [one for one in came if math.isfinite(when(one))]
        stayed = [one.session.id for one in came if not math.isfinite(when(one))]
        seconds = spread([when(one) - before(one) for one in went]).median
        cells = (
            count(len(came), [one.session.id for one in came]),
            count(len(went), [one.session.id for one in went]),
            count(len(stayed), stayed),
        )
        rows.append((words(label), *cells, number(seconds, 1)))
        came, before = went, when
    return rows


def _passing(checkpoint: int) -> Callable[[Measured], float]:
    return lambda one: one.milestones.checkpoints.get(checkpoint, math.nan)
