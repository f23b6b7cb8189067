"""Where participants went: the flow from arriving to answering, with reasons for every loss; the
orders of conditions; and the funnel page by page.

The flow follows CONSORT (Hopewell et al., BMJ 389, 2025): participants are shown in the condition
that was drawn for them first, and at the last stage that they reached. Each line is the one above
it less those who are named between.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

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
from experiments.dataset.levels import EXCLUDED, EXCLUDED_BY_PLAN, REPLACED, UNCOUNTED
from experiments.dataset.records import (
    COMPLETED,
    Dataset,
    ParticipantRecord,
    PlanExclusion,
    SessionRecord,
)

FLOW = ("arrived", "assigned", "exposed", "drove", "ended", "counted", "answered")
ARRIVED, ASSIGNED, EXPOSED, DROVE, ENDED, COUNTED, ANSWERED = range(len(FLOW))
# Of participants who withdrew: the stage that is kept of them (levels.STAGES).
OF_WITHDRAWN = {
    "arrived": ARRIVED,
    "assigned": ASSIGNED,
    "exposed": EXPOSED,
    "ended": ENDED,
    "answered": ENDED,
}
STILL_THERE = "not continued (yet)"
STAGES = (
    "exposed: the page showed the video of the task. drove: the participant moved the robot. ended:"
    " with an outcome. counted: a drive counts in the results. answered: the final questionnaire,"
    " about a drive that counts."
)
PLACED = (
    "Every line is the one above it minus the participants named in between. Participants are"
    " counted in the condition that was drawn for them first, and at the last stage that they"
    " reached; of withdrawn participants, only that stage is known."
)
Row = tuple[TableCell, ...]


def flow(dataset: Dataset) -> Table:
    """Return how many participants of a dataset of what counts came how far, why the others did
    not, and how the tasks of each condition ended.
    """
    found = _Flow.of(dataset)
    rows = list(found.rows(dataset.participants, "all"))
    cells = dict.fromkeys(filter(None, map(_first_cell, dataset.participants)))
    for cell in cells if len(cells) > 1 else ():
        own = [one for one in dataset.participants if _first_cell(one) == cell]
        rows += [*found.rows(own, cell)][1:]
    below = (STAGES, PLACED, *_about_platform(dataset))
    head = ("Condition", "Stage", "Reason", "Participants")
    return Table("flow", "Flow of participants.", head, tuple(rows), below)


def _first_cell(one: ParticipantRecord) -> str:
    """Return the cell that was drawn first; older datasets have the last one alone."""
    return one.first_cell or one.cell


def _about_platform(dataset: Dataset) -> Iterator[str]:
    reasons = Counter(one.fault for one in dataset.others if one.fault)
    for reason, n in sorted(reasons.items()):
        yield (
            f"Excluded by rule, because the platform ended them: {amount(n, 'session')} ({reason})."
            " They count in no other table or figure."
        )


@dataclass(frozen=True)
class _Flow:
    """The drives of the task by participant, whether they count or not, and who answered."""

    dataset: Dataset
    drives: dict[str, list[SessionRecord]]
    answered: frozenset[str]
    excluded: dict[str, PlanExclusion]

    @classmethod
    def of(cls, dataset: Dataset) -> "_Flow":
        drives: dict[str, list[SessionRecord]] = {}
        both = (*dataset.sessions, *dataset.others)
        for one in sorted(both, key=lambda one: (one.visit, one.round)):
            drives.setdefault(one.participant, []).append(one)
        answered = frozenset(
            one.participant
            for one in dataset.responses
            if one.questionnaire == dataset.study.analysis.statements and one.finished
        )
        excluded = {one.participant: one for one in dataset.exclusions if not one.session}
        return cls(dataset, drives, answered, excluded)

    def stage(self, one: ParticipantRecord) -> int:
        """Return the last stage of FLOW that a participant reached, by its number."""
        drives = self.drives.get(one.id, [])
        is_assigned = bool(_first_cell(one) or drives)
        if one.withdrawn:
            return OF_WITHDRAWN.get(one.stage, ASSIGNED if is_assigned else ARRIVED)
        reached = (
            is_assigned,
            any(it.exposed for it in drives),
            any(it.drove for it in drives),
            any(it.drove and it.outcome for it in drives),
            any(it.counts for it in drives),
            one.id in self.answered,
        )
        return next((n for n, is_true in enumerate(reached) if not is_true), len(reached))

    def rows(self, people: Sequence[ParticipantRecord], cell: str) -> Iterator[Row]:
        """Yield the lines of some participants."""
        stages = {one.id: self.stage(one) for one in people}
        for number_, stage in enumerate(FLOW):
            lost = [one for one in people if stages[one.id] == number_ - 1]
            for reason, n in sorted(Counter(self._reason(one, number_) for one in lost).items()):
                ids = [one.id for one in lost if self._reason(one, number_) == reason]
                yield words(cell), words(""), words(reason), self._count(n, ids)
            left = [one for one in people if stages[one.id] >= number_]
            yield words(cell), words(stage), words(""), self._count(len(left), _ids(left))
            if number_ == ASSIGNED:
                yield from self._among(cell, "drawn anew", [it for it in left if it.draws > 1])
            if number_ == EXPOSED:
                replaced = [it for it in left if it.place == REPLACED]
                yield from self._among(cell, "replaced by another participant", replaced)
            if number_ == ENDED:
                yield from self._outcomes(left, cell)

    def _count(self, n: int, ids: Collection[str]) -> TableCell:
        return count(n, self.dataset.sessions_of(ids))

    def _among(self, cell: str, what: str, people: Sequence[ParticipantRecord]) -> Iterator[Row]:
        if people:
            found = self._count(len(people), _ids(people))
            yield words(cell), words(""), words(f"among them: {what}"), found

    def _reason(self, one: ParticipantRecord, stage: int) -> str:
        """Return why a participant did not reach a stage."""
        if one.withdrawn:
            return "left: withdrew"
        if stage == COUNTED:
            return self._uncounted(one)
        if one.left:
            return f"left: {spoken(one.left)}"
        if one.finished:
            return f"left: finished without {'answers' if stage == ANSWERED else 'a drive'}"
        drives = self.drives.get(one.id, [])
        lost = [it.outcome for it in drives if it.outcome not in {"", COMPLETED}]
        return f"left: {spoken(lost[-1]) if lost and stage < ENDED else STILL_THERE}"

    def _uncounted(self, one: ParticipantRecord) -> str:
        last = [it for it in self.drives[one.id] if it.drove and it.outcome][-1]
        if last.counts_why == EXCLUDED_BY_PLAN:
            return f"excluded: {self.excluded[one.id].rule}"
        if last.counts_why == EXCLUDED:
            return "excluded: researcher's decision"
        return f"excluded: {last.fault or UNCOUNTED[last.counts_why]}"

    def _outcomes(self, people: Sequence[ParticipantRecord], cell: str) -> Iterator[Row]:
        """Yield how the first tasks ended that participants drove."""
        first = [
            next((it for it in self.drives.get(one.id, []) if it.drove and it.outcome), None)
            for one in people
        ]
        known = [one for one in first if one is not None]
        for outcome in sorted({one.outcome for one in known}):
            ids = [one.id for one in known if one.outcome == outcome]
            label = f"first task: {spoken(outcome)}"
            yield words(cell), words(""), words(label), count(len(ids), ids)


def _ids(people: Sequence[ParticipantRecord]) -> list[str]:
    return [one.id for one in people]


def orders(dataset: Dataset) -> Table:
    """Return how many participants had each order of conditions, a check of counterbalancing; no
    rows where a participant has one condition.
    """
    cells = sorted({one.cell for one in dataset.participants if "-" in one.cell})
    driven: dict[str, set[str]] = {}
    for one in dataset.sessions:
        driven.setdefault(one.participant, set()).add(one.condition)
    rows = []
    for cell in cells:
        own = [one.id for one in dataset.participants if one.cell == cell]
        some = [who for who in own if who in driven]
        whole = [who for who in some if driven[who] >= set(cell.split("-"))]
        counts = (count(len(ids), dataset.sessions_of(ids)) for ids in (own, some, whole))
        rows.append((words(cell), *counts))
    head = ("Condition", "Assigned", "With a drive that counts", "With all conditions")
    return Table("orders", "Participants by order of conditions.", head, tuple(rows))


def fault_sides(dataset: Dataset) -> Table:
    """Return on which side it lay that drives were not completed, by outcome; with those that do
    not count.
    """
    ended = [
        one for one in (*dataset.sessions, *dataset.others) if one.outcome not in {"", COMPLETED}
    ]
    keys = sorted({(one.outcome, one.fault_side) for one in ended})
    rows = tuple(
        (words(spoken(outcome)), words(side or "nobody"), count(len(ids), ids))
        for outcome, side in keys
        for ids in [[one.id for one in ended if (one.outcome, one.fault_side) == (outcome, side)]]
    )
    below = (
        "All drives of the task, also those that do not count. Platform: the server was unavailable"
        " when the connection was lost; network: the connection was lost, and the visitor had not"
        " closed the page."
    )
    head = ("Outcome", "Side", "Sessions")
    return Table("fault-sides", "Sessions that were not completed, by side.", head, rows, (below,))


# --- the funnel -----------------------------------------------------------------------------------


def funnel(dataset: Dataset, measured: Sequence[Measured]) -> Table:
    """Return a line a page and milestone: how many came, how many went on, and the median of the
    seconds that it took. `measured` are all drives of the task, whether they count or not.
    """
    study = dataset.study
    steps = [step.key for step in study.steps]
    task = steps.index(study.task.key) + 1 if study.task is not None else len(steps)
    extra = [key for key in dict.fromkeys(page.step for page in dataset.pages) if key not in steps]
    rows = (
        *(_page_row(dataset, key) for key in (*extra, *steps[:task])),
        *_milestone_rows(dataset, measured),
        *(_page_row(dataset, key) for key in steps[task:]),
    )
    people = amount(len(dataset.participants), "participant")
    below = (
        f"{people}, {amount(len(measured), 'session')}. Pages are counted by participant,"
        " milestones by session, with the sessions that do not count. Stopped: left, or is still"
        " there. The last page is reached by going on."
    )
    head = ("Page or milestone", "Came", "Went on", "Stopped", "Median (s)")
    return Table("funnel", "Funnel.", head, rows, (below,))


def _page_row(dataset: Dataset, key: str) -> Row:
    step = dataset.study.step(key)
    is_end = step is not None and step.is_end
    pages = [page for page in dataset.pages if page.step == key]
    came = {page.participant for page in pages}
    went = {page.participant for page in pages if page.finished or is_end}
    seconds = spread([page.seconds for page in pages if page.finished]).median
    cells = (count(len(ids), dataset.sessions_of(ids)) for ids in (came, went, came - went))
    return words(dataset.say(step.title) if step else key), *cells, number(seconds, 1)


def _milestone_rows(dataset: Dataset, measured: Sequence[Measured]) -> Iterator[Row]:
    """Yield each milestone with the seconds since the one before it, of the sessions that reached
    both.
    """
    stops = {stop.number for course in dataset.study.courses for stop in course.checkpoints}
    times: list[tuple[str, Callable[[Measured], float]]] = [
        ("first video frame", lambda one: one.milestones.start),
        ("first motion", lambda one: one.milestones.motion),
        *((f"checkpoint {n}", _passing(n)) for n in sorted(stops) if n > 0),
        ("docked", lambda one: one.milestones.docked),
    ]
    came = list(measured)
    before: Callable[[Measured], float] = lambda _: 0.0  # noqa: E731 -- one of several of its kind
    for label, when in times:
        went = [one for one in came if math.isfinite(when(one))]
        stopped = [one for one in came if not math.isfinite(when(one))]
        seconds = spread([when(one) - before(one) for one in went]).median
        groups = ([one.session.id for one in group] for group in (came, went, stopped))
        yield words(label), *(count(len(ids), ids) for ids in groups), number(seconds, 1)
        came, before = went, when


def _passing(checkpoint: int) -> Callable[[Measured], float]:
    return lambda one: one.milestones.checkpoints.get(checkpoint, math.nan)
