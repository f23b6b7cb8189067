"""What a dress rehearsal says of a study, from the diaries of the bots that played it. Pure:
diaries in, a report out.

Bots read at once, answer at once and drive without hesitating. So what people will need is reckoned
from what bots met: words to read, questions to answer, and the time of the drive by a factor.
"""

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from experiments.analysis.power.exact import LARGE, MEDIUM, SMALL, participants_needed
from experiments.bots.diary import Diary, Leg
from experiments.definition import factors
from experiments.definition.schema import Condition, StudyDefinition
from experiments.rehearsal.issues import Issue

# how many times longer people drive than bots: the paper's drives took 4 min 34 s on average, a
# bot's on such a course 2.5
DRIVER = 1.8
WORDS_A_MINUTE = 200.0
SECONDS_A_QUESTION = 7.0
# the time limit must leave so many times what the slowest bot took, or people run out of it
SLOWEST = 2.5
ENOUGH = 1  # drives that must have been completed in each condition
COMPLETED = "completed"


@dataclass
class ConditionReport:
    """One condition: what was driven, which checkpoints nobody passed, how long it took (seconds),
    and what people will need (minutes).
    """

    key: str
    drives: int = 0
    completed: int = 0
    missed: list[int] = field(default_factory=list)
    outcomes: dict[str, int] = field(default_factory=dict)
    median_seconds: float | None = None
    longest_seconds: float | None = None
    expected_minutes: float | None = None
    limit_minutes: float = 0.0
    doors_closed: list[str] = field(default_factory=list)
    doors_found_closed: list[str] = field(default_factory=list)
    mismatches: list[str] = field(default_factory=list)


@dataclass
class StepReport:
    """One page of the study, by its heading: how many bots saw it, how much there was on it, how
    long people will take (minutes), and whether it `drives` the robot.
    """

    heading: str
    bots: int
    words: int
    questions: int
    expected_minutes: float
    drives: bool = False


@dataclass
class RehearsalReport:
    """All of it. `problems` stand in the way of publishing, `notes` do not; each is one sentence,
    and `issues` has all of them as they were found.
    """

    bots: int
    passed: bool = False
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    issues: list[Issue] = field(default_factory=list)
    conditions: list[ConditionReport] = field(default_factory=list)
    steps: list[StepReport] = field(default_factory=list)
    expected_minutes: float = 0.0
    empty_columns: list[str] = field(default_factory=list)
    drawn: list[str] = field(default_factory=list)
    power: list[dict[str, float]] = field(default_factory=list)

    def as_data(self) -> dict[str, Any]:
        """Return it as plain data, for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class DriveRecord:
    """What the database says of a bot's drive: its condition, outcome, and how what was in force
    differs from what was assigned.
    """

    condition: str
    outcome: str = ""
    passed: int = 0
    seconds: float | None = None
    mismatches: tuple[str, ...] = ()
    practice: bool = False


@dataclass(frozen=True)
class Findings:
    """What was found besides the diaries: drives by session, columns without a value, what was
    drawn, and why something was not.

    `discrepancies` are sentences on drives whose records give something else than is stored
    (experiments/rehearsal/replay_check.py).
    """

    records: Mapping[str, DriveRecord] = field(default_factory=dict)
    empty_columns: Sequence[str] = ()
    drawn: Sequence[str] = ()
    not_drawn: Sequence[str] = ()
    discrepancies: Sequence[str] = ()


def judge(study: StudyDefinition, diaries: Sequence[Diary], found: Findings) -> RehearsalReport:
    """Return what the rehearsal says."""
    report = RehearsalReport(len(diaries))
    report.conditions = [
        _condition(study, condition, diaries, found) for condition in study.conditions
    ]
    report.steps = _steps(diaries)
    report.expected_minutes = round(_whole(diaries, report.conditions, study), 1)
    report.empty_columns, report.drawn = sorted(found.empty_columns), sorted(found.drawn)
    report.power = _power(study)
    report.issues = [
        *_problems_of(study, report),
        *_stuck(diaries),
        *(Issue("not_drawn", {"what": name}) for name in found.not_drawn),
        *(Issue("differs", {"what": sentence}) for sentence in found.discrepancies),
        *_notes(report),
    ]
    report.problems = [one.sentence() for one in report.issues if one.is_problem]
    report.notes = [one.sentence() for one in report.issues if not one.is_problem]
    report.passed = not report.problems
    return report


def _condition(
    study: StudyDefinition, condition: Condition, diaries: Sequence[Diary], found: Findings
) -> ConditionReport:
    task, course = study.task, study.course_of(condition)
    report = ConditionReport(
        condition.key,
        limit_minutes=task.minutes if task is not None else 0.0,
        doors_closed=list(condition.doors_closed),
    )
    own = [
        (leg, record)
        for leg, record in _legs(diaries, found)
        if record.condition == condition.key and not record.practice
    ]
    report.drives = len(own)
    seconds = []
    passed: set[int] = set()
    for leg, record in own:
        outcome = record.outcome or leg.outcome or "none"
        report.outcomes[outcome] = report.outcomes.get(outcome, 0) + 1
        passed |= {*leg.passed, *range(1, record.passed + 1)}
        if outcome == COMPLETED and leg.passed:
            seconds.append(record.seconds if record.seconds is not None else leg.seconds)
        report.mismatches = sorted({*report.mismatches, *record.mismatches})
        report.doors_found_closed = sorted({*report.doors_found_closed, *leg.closed})
    report.completed = report.outcomes.get(COMPLETED, 0)
    report.missed = (
        [
            stop.number
            for stop in course.checkpoints
            if stop.number > 0 and stop.number not in passed
        ]
        if course is not None
        else []
    )
    if seconds:
        report.median_seconds, report.longest_seconds = (
            round(statistics.median(seconds), 1),
            round(max(seconds), 1),
        )
        report.expected_minutes = round(DRIVER * statistics.median(seconds) / 60.0, 1)
    return report


def _legs(diaries: Sequence[Diary], found: Findings) -> list[tuple[Leg, DriveRecord]]:
    legs = [leg for diary in diaries for leg in diary.legs if leg.session]
    return [(leg, found.records[leg.session]) for leg in legs if leg.session in found.records]


def _steps(diaries: Sequence[Diary]) -> list[StepReport]:
    pages: dict[tuple[str, bool], list[tuple[int, int]]] = {}
    for diary in diaries:
        for entry in diary.entries:
            if entry.heading:
                page = entry.heading, entry.drives
                pages.setdefault(page, []).append((entry.words, entry.questions))
    return [_step(heading, seen, drives=drives) for (heading, drives), seen in pages.items()]


def _step(heading: str, seen: Sequence[tuple[int, int]], *, drives: bool) -> StepReport:
    words, questions = (
        round(statistics.median(one[0] for one in seen)),
        round(statistics.median(one[1] for one in seen)),
    )
    minutes = round(_minutes(words, questions), 1)
    return StepReport(heading, len(seen), words, questions, minutes, drives)


def _minutes(words: int, questions: int) -> float:
    return words / WORDS_A_MINUTE + questions * SECONDS_A_QUESTION / 60.0


def _whole(
    diaries: Sequence[Diary], conditions: Sequence[ConditionReport], study: StudyDefinition
) -> float:
    """Return the minutes that a person needs from the link to the code: the median of the bots'
    pages, and the drives.
    """
    through = [diary for diary in diaries if diary.code and diary.ending == "completes"]
    if not through:
        return 0.0
    reading = statistics.median(
        sum(_minutes(entry.words, entry.questions) for entry in diary.entries) for diary in through
    )
    together = max((len(group) for group in factors.groups(study, "open")), default=1)
    rounds = together if study.allocation.design == "within" else 1
    drives = [one.expected_minutes for one in conditions if one.expected_minutes is not None]
    practice = sum(step.minutes for step in study.drives if step.is_practice)
    return reading + rounds * ((statistics.mean(drives) if drives else 0.0) + practice)


def _power(study: StudyDefinition) -> list[dict[str, float]]:
    by_access = [
        sum(1 for one in study.conditions if one.access == access)
        for access in ("open", "invitation")
    ]
    groups = max(by_access)
    needs = (
        [
            participants_needed(effect, study.allocation.design, groups=groups)
            for effect in (SMALL, MEDIUM, LARGE)
        ]
        if groups > 1
        else []
    )
    return [
        {"effect": need.effect, "per_group": need.per_group, "total": need.total}
        for need in needs
        if need is not None
    ]


def _problems_of(study: StudyDefinition, report: RehearsalReport) -> Iterator[Issue]:
    for one in report.conditions:
        if one.completed < ENOUGH:
            yield Issue("not_completed", {"drives": one.drives}, one.key)
        yield from (Issue("missed", {"number": number}, one.key) for number in one.missed)
        longest = one.longest_seconds
        if longest is not None and longest * SLOWEST > one.limit_minutes * 60.0:
            told = {
                "minutes": f"{longest / 60.0:.1f}",
                "limit": f"{one.limit_minutes:g}",
                "allow": math.ceil(longest * SLOWEST / 60.0),
            }
            yield Issue("too_short", told, one.key)
        yield from (Issue("not_applied", {"what": name}, one.key) for name in one.mismatches)
    if study.task is None:
        yield Issue("no_task")


def _stuck(diaries: Sequence[Diary]) -> Iterator[Issue]:
    for one in diaries:
        if one.stuck:
            last = one.entries[-1].heading if one.entries else ""
            yield Issue("stuck", {"bot": one.number, "where": one.stuck}, place=last)
        elif one.ending == "completes" and not one.code:
            yield Issue("no_code", {"bot": one.number})


def _notes(report: RehearsalReport) -> Iterator[Issue]:
    yield from (Issue("empty", {"column": name}) for name in report.empty_columns)
    for one in report.conditions:
        unseen = sorted(set(one.doors_closed) - set(one.doors_found_closed))
        yield from (Issue("unseen_door", {"door": name}, one.key) for name in unseen)
