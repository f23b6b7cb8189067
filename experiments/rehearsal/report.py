"""The report on a rehearsal, from the logs of its bots and from the database. Pure.

Bots read and answer at once, and drive without hesitating. So the times of people are estimated
from the words to read, the questions to answer, and the time of a bot's drive.
"""

import math
import statistics
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from experiments.analysis.power.exact import LARGE, MEDIUM, SMALL, participants_needed
from experiments.bots.diary import Diary, PageVisit
from experiments.definition import factors
from experiments.definition.schema import Condition, StudyDefinition
from surveys.document_forms.guide import word_table

# times longer that people drive than bots: the paper's drives took 4 min 34 s on average, a bot's
# on such a course 2.5 min
DRIVER = 1.8
WORDS_A_MINUTE = 200.0
SECONDS_A_QUESTION = 7.0
# times the slowest bot's time that the limit must leave, or people run out of it
SLOWEST = 2.5
ENOUGH = 1  # drives that must have been completed in each condition
COMPLETED = "completed"
_ISSUES = word_table(__file__, "issues.csv")
# Each kind of issue and its sentence, which pages translate. Problems prevent publishing.
PROBLEMS, NOTES = (
    {row["kind"]: row["words"] for row in _ISSUES if row["severity"] == severity}
    for severity in ("problem", "note")
)


@dataclass(frozen=True)
class Issue:
    """An issue: its kind, the values in its sentence, and the key of its condition, if any. `place`
    is the heading of the page where it is corrected.
    """

    kind: str
    values: dict[str, Any] = field(default_factory=dict)
    condition: str = ""
    place: str = ""

    @property
    def is_problem(self) -> bool:
        return self.kind in PROBLEMS

    @property
    def template(self) -> str:
        """The sentence without its values, so that it can be translated."""
        return (PROBLEMS | NOTES)[self.kind]

    def sentence(self) -> str:
        sentence = self.template % self.values
        return f"Condition {self.condition}: {sentence}" if self.condition else sentence


@dataclass
class ConditionReport:
    """A condition: its drives, the checkpoints that no bot passed (`missed`), the seconds of the
    bots, and the minutes that people will need.
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
    """A page of the study, by its heading: how many bots saw it, the numbers of its words and
    questions, the minutes that people will take, and whether it `drives` the robot.
    """

    heading: str
    bots: int
    words: int
    questions: int
    expected_minutes: float
    drives: bool = False


@dataclass
class RehearsalReport:
    """All of it. `problems` prevent publishing, `notes` do not: the sentences of `issues`."""

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


@dataclass(frozen=True)
class DriveRecord:
    """A bot's drive in the database; `mismatches` are settings not applied as assigned."""

    condition: str
    outcome: str = ""
    passed: int = 0
    seconds: float | None = None
    mismatches: tuple[str, ...] = ()
    practice: bool = False


@dataclass(frozen=True)
class Findings:
    """The records of a rehearsal: drives by session, columns without a value, the names of tables
    and figures that were drawn, and why others were not. `discrepancies` are sentences on drives
    whose stored records give another result than the stored one.
    """

    records: Mapping[str, DriveRecord] = field(default_factory=dict)
    empty_columns: Sequence[str] = ()
    drawn: Sequence[str] = ()
    not_drawn: Sequence[str] = ()
    discrepancies: Sequence[str] = ()


def judge(study: StudyDefinition, diaries: Sequence[Diary], found: Findings) -> RehearsalReport:
    conditions = [_condition(study, one, diaries, found) for one in study.conditions]
    issues = [
        *chain.from_iterable(map(_problems_of, conditions)),
        *([Issue("no_task")] if study.task is None else []),
        *_stuck(diaries),
        *(Issue("not_drawn", {"what": name}) for name in found.not_drawn),
        *(Issue("differs", {"what": sentence}) for sentence in found.discrepancies),
        *(Issue("empty", {"column": name}) for name in sorted(found.empty_columns)),
        *(
            Issue("unseen_door", {"door": name}, one.key)
            for one in conditions
            for name in sorted(set(one.doors_closed) - set(one.doors_found_closed))
        ),
    ]
    problems = [one.sentence() for one in issues if one.is_problem]
    return RehearsalReport(
        len(diaries),
        passed=not problems,
        problems=problems,
        notes=[one.sentence() for one in issues if not one.is_problem],
        issues=issues,
        conditions=conditions,
        steps=_steps(diaries),
        expected_minutes=round(_whole(diaries, conditions, study), 1),
        empty_columns=sorted(found.empty_columns),
        drawn=sorted(found.drawn),
        power=_power(study),
    )


def _condition(
    study: StudyDefinition, condition: Condition, diaries: Sequence[Diary], found: Findings
) -> ConditionReport:
    legs = [leg for diary in diaries for leg in diary.legs if leg.session in found.records]
    drives = [(leg, found.records[leg.session]) for leg in legs]
    own = [one for one in drives if one[1].condition == condition.key and not one[1].practice]
    outcomes = Counter(record.outcome or leg.outcome or "none" for leg, record in own)
    seconds = [
        leg.seconds if record.seconds is None else record.seconds
        for leg, record in own
        if (record.outcome or leg.outcome) == COMPLETED and leg.passed
    ]
    passed = {n for leg, record in own for n in (*leg.passed, *range(1, record.passed + 1))}
    course = study.course_of(condition)
    stops = [stop.number for stop in course.checkpoints] if course is not None else []
    median = statistics.median(seconds) if seconds else None
    return ConditionReport(
        condition.key,
        drives=len(own),
        completed=outcomes[COMPLETED],
        missed=[number for number in stops if number > 0 and number not in passed],
        outcomes=dict(outcomes),
        median_seconds=None if median is None else round(median, 1),
        longest_seconds=round(max(seconds), 1) if seconds else None,
        expected_minutes=None if median is None else round(DRIVER * median / 60.0, 1),
        limit_minutes=study.task.minutes if study.task is not None else 0.0,
        doors_closed=list(condition.doors_closed),
        doors_found_closed=sorted({door for leg, _record in own for door in leg.closed}),
        mismatches=sorted({name for _leg, record in own for name in record.mismatches}),
    )


def _steps(diaries: Sequence[Diary]) -> list[StepReport]:
    pages: dict[tuple[str, bool], list[PageVisit]] = {}
    for entry in (entry for diary in diaries for entry in diary.entries if entry.heading):
        pages.setdefault((entry.heading, entry.drives), []).append(entry)
    reports = []
    for (heading, drives), seen in pages.items():
        words = round(statistics.median(one.words for one in seen))
        questions = round(statistics.median(one.questions for one in seen))
        minutes = round(_minutes(words, questions), 1)
        reports.append(StepReport(heading, len(seen), words, questions, minutes, drives))
    return reports


def _minutes(words: int, questions: int) -> float:
    return words / WORDS_A_MINUTE + questions * SECONDS_A_QUESTION / 60.0


def _whole(
    diaries: Sequence[Diary], conditions: Sequence[ConditionReport], study: StudyDefinition
) -> float:
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
    groups = max(Counter(one.access for one in study.conditions).values(), default=0)
    if groups < 2:
        return []
    design = study.allocation.design
    return [
        {"effect": need.effect, "per_group": need.per_group, "total": need.total}
        for effect in (SMALL, MEDIUM, LARGE)
        if (need := participants_needed(effect, design, groups=groups)) is not None
    ]


def _problems_of(one: ConditionReport) -> Iterator[Issue]:
    if one.completed < ENOUGH:
        yield Issue("not_completed", {"drives": one.drives}, one.key)
    yield from (Issue("missed", {"number": number}, one.key) for number in one.missed)
    longest = one.longest_seconds
    if longest is not None and longest * SLOWEST > one.limit_minutes * 60.0:
        values = {
            "minutes": f"{longest / 60.0:.1f}",
            "limit": f"{one.limit_minutes:g}",
            "allow": math.ceil(longest * SLOWEST / 60.0),
        }
        yield Issue("too_short", values, one.key)
    yield from (Issue("not_applied", {"what": name}, one.key) for name in one.mismatches)


def _stuck(diaries: Sequence[Diary]) -> Iterator[Issue]:
    for one in diaries:
        if one.stuck:
            last = one.entries[-1].heading if one.entries else ""
            yield Issue("stuck", {"bot": one.number, "where": one.stuck}, place=last)
        elif one.ending == "completes" and not one.code:
            yield Issue("no_code", {"bot": one.number})
