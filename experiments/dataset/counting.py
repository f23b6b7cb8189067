"""Which drives count in results, and why each of the others does not.

A drive of the task counts if its participant is of a chosen kind, saw the video of the task and
moved the robot; if it has ended, and not by a fault of the platform; if neither a researcher nor a
rule of the plan excludes it; and if the study counts it, of several drives by one participant in
one condition (`Analysis.drives`). Every table, figure, test, flow chart, sheet and column of an
export follows from `counting`. Only success and times have more drives, those of `attempted`:
participants who gave up before they moved the robot, or whom the plan excludes because something is
missing, have not succeeded, and may not be left out for that.

A participant who was assigned again counts in one cell: that of the first drive that counts.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from experiments.dataset import levels
from experiments.dataset.exclusions import excluded_participants, exclusions
from experiments.dataset.grouping import by_key
from experiments.dataset.levels import PLATFORM, Kind
from experiments.dataset.record_quality import excluding_faults
from experiments.dataset.records import Dataset, PlanExclusion, ResponseRecord, SessionRecord
from experiments.definition.factors import conditions_together, steps_about_drive
from experiments.definition.schema import StudyDefinition

PARTICIPANTS: tuple[Kind, ...] = ("participant",)


@dataclass(frozen=True)
class CountingPlan:
    """The conditions, besides the drive itself, for a drive to count: `kinds` are chosen, the data
    of `withdrawn` participants may not be used, and rules of the plan exclude those in `excluded`,
    and those in `incomplete` because they lack a drive or a questionnaire; `faulty` are drives that
    it excludes by their records. With `with_excluded`, excluded drives count as well, as in a
    sensitivity analysis.
    """

    kinds: Collection[Kind]
    withdrawn: Collection[str]
    excluded: Collection[str] = frozenset()
    incomplete: Collection[str] = frozenset()
    faulty: Collection[str] = frozenset()
    with_excluded: bool = False


def _why_not(session: SessionRecord, plan: CountingPlan) -> str:
    """Return why a drive by itself does not count (levels.UNCOUNTED); empty if it may."""
    reasons = (
        (levels.PRACTICE, session.practice),
        (session.kind, session.kind not in plan.kinds),
        (levels.WITHDRAWN, session.participant in plan.withdrawn),
        (levels.PLATFORM_FAULT, session.fault_side == PLATFORM),
        (levels.RUNNING, not session.outcome),
        (levels.NOT_EXPOSED, not session.exposed),
        (levels.EXCLUDED, session.excluded and not plan.with_excluded),
        (levels.EXCLUDED_BY_PLAN, session.participant in plan.excluded),
        (levels.FAULTY, session.id in plan.faulty),
        (levels.NOT_DRIVEN, not session.drove),
        (levels.INCOMPLETE, session.participant in plan.incomplete),
    )
    return next((code for code, is_so in reasons if is_so), "")


def _reasons(dataset: Dataset, plan: CountingPlan) -> dict[str, str]:
    """Return the code for which each drive does not count, by its id; empty for those that count.
    Drives are in the order of time, participant by participant.
    """
    found = {one.id: _why_not(one, plan) for one in dataset.sessions}
    for code, some in ((levels.DRAWN_ANEW, _drawn_anew), (levels.REPEATED, _repeated)):
        left = [one for one in dataset.sessions if not found[one.id]]
        found |= {one.id: code for one in some(dataset.study, left)}
    return found


def _drawn_anew(
    study: StudyDefinition, sessions: Iterable[SessionRecord]
) -> Iterator[SessionRecord]:
    """Yield drives in conditions that a participant may not have beside that of their first."""
    together = [frozenset(keys) for keys in conditions_together(study)]
    own: dict[str, frozenset[str]] = {}
    for one in sessions:
        alone = frozenset({one.condition})
        cell = next((keys for keys in together if one.condition in keys), alone)
        if one.condition not in own.setdefault(one.participant, cell):
            yield one


def _repeated(study: StudyDefinition, sessions: Sequence[SessionRecord]) -> Iterator[SessionRecord]:
    """Yield all but the first or the last drive of a participant in a condition, by the study."""
    if study.analysis.drives == "all":
        return
    seen: set[tuple[str, str]] = set()
    for one in sessions if study.analysis.drives == "first" else reversed(sessions):
        key = (one.participant, one.condition)
        if key in seen:
            yield one
        seen.add(key)


def _numbered(sessions: Iterable[SessionRecord]) -> Iterator[SessionRecord]:
    """Yield drives with their numbers: the first, second … of a participant in a condition, of
    those in which they moved the robot; 0 for all others. Without a visit, as in datasets of
    earlier releases, the number is that of the visit: no visit has a condition twice.
    """
    counts: dict[tuple[str, str], int] = {}
    for one in sessions:
        number = 0
        if one.drove and not one.practice and one.fault_side != PLATFORM:
            key = (one.participant, one.condition)
            number = counts[key] = counts.get(key, 0) + 1
        yield replace(one, number=number, visit=one.visit or max(number, 1))


def visits_of(sessions: Iterable[SessionRecord]) -> dict[str, int]:
    """Return the number of the visit of each drive, by its id: 1 for the participant's first visit
    with one of these drives, 2 for the next such visit.
    """
    sessions = list(sessions)
    visits = by_key(sorted({(one.participant, one.visit) for one in sessions}))
    return {one.id: 1 + visits[one.participant].index(one.visit) for one in sessions}


def counting(
    dataset: Dataset, kinds: Sequence[Kind] = PARTICIPANTS, *, with_excluded: bool = False
) -> Dataset:
    """Return the part of a whole dataset that counts: participants of some kinds with the drives
    that count, the answers about these, and all pages and events of their task. With
    `with_excluded`, excluded drives count as well, as in a sensitivity analysis.
    """
    plan, found = _plan_of(dataset, kinds)
    if with_excluded:
        plan = replace(plan, excluded=(), incomplete=(), faulty=(), with_excluded=True)
    return replace(_selected(dataset, plan), exclusions=found, is_with_excluded=with_excluded)


def attempted(dataset: Dataset) -> tuple[SessionRecord, ...]:
    """Return the drives of which success and times are, of a dataset of what counts: those that
    count; those of participants who are excluded because they are incomplete; and, of participants
    who saw the video and never moved the robot under a condition, the last one under it, which is a
    failure. Whether people leave may depend on the condition that they saw (intention to treat;
    only those who were not exposed may be left out: ICH E9, 5.2.1).
    """
    incomplete = [one for one in dataset.others if one.counts_why == levels.INCOMPLETE]
    found = [*dataset.sessions, *incomplete]
    moved = {(one.participant, one.condition) for one in found}
    still = [one for one in dataset.others if one.counts_why == levels.NOT_DRIVEN]
    last = {(one.participant, one.condition): one for one in still}
    found += [one for place, one in last.items() if place not in moved]
    for some in (_drawn_anew, _repeated):
        left_out = {one.id for one in some(dataset.study, found)}
        found = [one for one in found if one.id not in left_out]
    return tuple(found)


def with_reasons(dataset: Dataset) -> Dataset:
    """Return a whole dataset whose sessions state why they do not count (`counts_why`)."""
    found = _reasons(dataset, _plan_of(dataset, PARTICIPANTS)[0])
    sessions = (replace(one, counts_why=found[one.id]) for one in _numbered(dataset.sessions))
    return replace(dataset, sessions=tuple(sessions))


def _plan_of(
    dataset: Dataset, kinds: Sequence[Kind]
) -> tuple[CountingPlan, tuple[PlanExclusion, ...]]:
    """Return the plan with the participants whom its rules exclude, and all exclusions."""
    withdrawn = frozenset(one.id for one in dataset.participants if one.withdrawn)
    plan = CountingPlan(kinds, withdrawn)
    judged = [one for one in dataset.sessions if _why_not(one, plan) in {"", levels.NOT_DRIVEN}]
    faulty = frozenset(one.id for one in judged if excluding_faults(dataset, one))
    plan = replace(plan, faulty=faulty)
    found = exclusions(_selected(dataset, plan))
    excluded = excluded_participants(found, {levels.ATTENTION, levels.SPEEDER})
    incomplete = excluded_participants(found, {levels.INCOMPLETE}) - excluded
    return replace(plan, excluded=excluded, incomplete=incomplete), found


def _selected(dataset: Dataset, plan: CountingPlan) -> Dataset:
    people = tuple(one for one in dataset.participants if one.kind in plan.kinds)
    known = {one.id for one in people} - set(plan.withdrawn)
    found = _reasons(dataset, plan)
    own = [
        replace(one, counts_why=found[one.id])
        for one in _numbered(dataset.sessions)
        if one.participant in known and one.kind in plan.kinds and not one.practice
    ]
    sessions = tuple(one for one in own if one.counts)
    ids = {one.id for one in own}
    return replace(
        dataset,
        participants=people,
        sessions=sessions,
        others=tuple(one for one in own if not one.counts),
        events=tuple(one for one in dataset.events if one.session in ids),
        pages=tuple(one for one in dataset.pages if one.participant in known),
        responses=tuple(_answers(dataset, sessions, known - set(plan.excluded))),
    )


def _answers(
    dataset: Dataset, sessions: Iterable[SessionRecord], people: Collection[str]
) -> Iterator[ResponseRecord]:
    """Yield the responses about the person and about drives that count. One that is about several
    conditions is about none of their drives, and needs one drive of the participant that counts.
    """
    ids = {one.id for one in sessions}
    drivers = {one.participant for one in sessions}
    about_drive = steps_about_drive(dataset.study)
    for one in dataset.responses:
        step = dataset.asking(one)
        if one.participant not in people or step is None:
            continue
        if step.key in about_drive:
            if one.session in ids:
                yield one
        elif step.is_about_person or one.participant in drivers:
            yield replace(one, session="")
