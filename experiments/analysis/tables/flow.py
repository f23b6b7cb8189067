"""Where participants went: the flow from arriving to answering, with reasons for every loss; the
orders of conditions; and the funnel page by page.

The flow follows CONSORT (Hopewell et al., BMJ 389, 2025): participants are shown in the condition
that was drawn for them first, and at the last stage that they reached. Each line is the one above
it less those who are named between.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence

from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.descriptive import spread
from experiments.analysis.tables import table
from experiments.dataset.counting import attempted
from experiments.dataset.grouping import by_key
from experiments.dataset.levels import (
    EXCLUDED,
    EXCLUDED_BY_PLAN,
    FAULTY,
    INCOMPLETE,
    NOT_DRIVEN,
    REPLACED,
    UNCOUNTED,
)
from experiments.dataset.records import COMPLETED, Dataset, ParticipantRecord, SessionRecord

FLOW = ("arrived", "assigned", "exposed", "drove", "ended", "counted", "answered")
ARRIVED, ASSIGNED, EXPOSED, DROVE, ENDED, COUNTED, ANSWERED = range(len(FLOW))
# Of participants who withdrew: the stage that is kept of them (levels.STAGES).
OF_WITHDRAWN = {stage: min(n, ENDED) for n, stage in enumerate(FLOW)}
STILL_THERE = "not continued (yet)"
STAGES = (
    "exposed: the page showed the video of the task. drove: the participant moved the robot. ended:"
    " with an outcome. counted: a drive counts in the results. answered: the final questionnaire,"
    " about a drive that counts. analysed: the participants behind each outcome. Success and"
    " times also have those who saw the video and never moved the robot, and those whom the plan"
    " excludes as incomplete."
)
PLACED = (
    "Every line is the one above it minus the participants named in between. Participants are"
    " counted in the condition that was drawn for them first, and at the last stage that they"
    " reached; of withdrawn participants, only that stage is known. Participants drawn anew"
    " are analysed in the condition that they drove."
)
Rows = Iterator[tuple[object, ...]]


def flow(dataset: Dataset) -> table.Table:
    """Return how many reached each stage, why the others did not, and how tasks ended."""
    found, people = _Flow(dataset), dataset.participants
    rows = list(found.rows(people, "all"))
    cells = dict.fromkeys(filter(None, map(_first_cell, people)))
    for cell in cells if len(cells) > 1 else ():
        rows += [*found.rows([one for one in people if _first_cell(one) == cell], cell)][1:]
    notes = (STAGES, PLACED, *_left_out(dataset))
    head = ("Condition", "Stage", "Reason", "Participants")
    return table.Table.of("flow", "Flow of participants.", head, rows, notes)


def _first_cell(one: ParticipantRecord) -> str:
    """Return the cell that was drawn first; older datasets have the last one alone."""
    return one.first_cell or one.cell


def _left_out(dataset: Dataset) -> Iterator[str]:
    if dataset.whole is not None:
        yield f"This dataset is public, so it has no row of those who withdrew: {dataset.withdrew}."
    reasons = Counter(one.fault for one in dataset.others if one.fault)
    for reason, n in sorted(reasons.items()):
        sessions = table.amount(n, "session")
        yield (
            f"Excluded by rule, because the platform ended them: {sessions} ({reason})."
            " They count in no other table or figure."
        )


def _analysed(dataset: Dataset) -> dict[str, set[str]]:
    """Return the participants behind each kind of outcome."""
    found = {
        "success and times": {one.participant for one in attempted(dataset)},
        "driving": {one.participant for one in dataset.sessions},
    }
    for variable, step in dataset.study.asked.items():
        if not step.is_about_person:
            own = (one for one in dataset.answers_to(variable) if one.finished)
            found[f"answers to {variable}"] = {one.participant for one in own}
    return found


class _Flow:
    """The drives of the task by participant, whether they count or not, and who answered."""

    def __init__(self, dataset: Dataset) -> None:
        self.dataset = dataset
        both = (*dataset.sessions, *dataset.others)
        in_order = sorted(both, key=lambda one: (one.visit, one.round))
        self.drives = by_key((one.participant, one) for one in in_order)
        answers = dataset.answers_to(dataset.study.statements)
        self.answered = {one.participant for one in answers if one.finished}
        self.analysed = _analysed(dataset)
        self.rules = {one.session or one.participant: one.rule for one in dataset.exclusions}

    def _ended(self, who: str) -> list[SessionRecord]:
        """Return the drives of a participant that ended with an outcome."""
        return [it for it in self.drives.get(who, []) if it.drove and it.outcome]

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
            bool(self._ended(one.id)),
            any(it.counts for it in drives),
            one.id in self.answered,
        )
        return next((n for n, is_true in enumerate(reached) if not is_true), len(reached))

    def rows(self, people: Sequence[ParticipantRecord], cell: str) -> Rows:
        stages = {one.id: self.stage(one) for one in people}
        for number, stage in enumerate(FLOW):
            stopped = [one for one in people if stages[one.id] == number - 1]
            lost = by_key((self._reason(one, number), one.id) for one in stopped)
            for reason, ids in sorted(lost.items()):
                yield cell, "", reason, table.people_count(self.dataset, ids)
            left = [one for one in people if stages[one.id] >= number]
            yield cell, stage, "", table.people_count(self.dataset, [one.id for one in left])
            if number == ARRIVED:
                excluded = self.dataset.excluded_people
                ids = [one.id for one in left if one.id in excluded]
                yield from self._among(cell, "excluded by the plan's rules", ids)
            if number == ASSIGNED:
                again = [one.id for one in left if one.draws > 1]
                yield from self._among(cell, "drawn anew", again)
            if number == EXPOSED:
                replaced = [one.id for one in left if one.place == REPLACED]
                yield from self._among(cell, "replaced by another participant", replaced)
            if number == ENDED:
                yield from self._outcomes(left, cell)
        for what, whom in self.analysed.items():
            ids = [one.id for one in people if one.id in whom]
            yield cell, "", f"analysed: {what}", table.people_count(self.dataset, ids)

    def _among(self, cell: str, what: str, ids: Sequence[str]) -> Rows:
        if ids:
            yield cell, "", f"among them: {what}", table.people_count(self.dataset, ids)

    def _reason(self, one: ParticipantRecord, stage: int) -> str:
        if one.withdrawn:
            return "left: withdrew"
        if stage == COUNTED:
            return self._uncounted(one)
        drives = self.drives.get(one.id, [])
        if stage == DROVE and any(it.counts_why == NOT_DRIVEN for it in drives):
            return "left: never moved the robot"
        if one.left:
            return f"left: {table.spoken(one.left)}"
        if one.finished:
            return f"left: finished without {'answers' if stage == ANSWERED else 'a drive'}"
        lost = [it.outcome for it in drives if it.outcome not in {"", COMPLETED}]
        return f"left: {table.spoken(lost[-1]) if lost and stage < ENDED else STILL_THERE}"

    def _uncounted(self, one: ParticipantRecord) -> str:
        last = self._ended(one.id)[-1]
        if last.counts_why in {EXCLUDED_BY_PLAN, INCOMPLETE, FAULTY}:
            return f"excluded: {self.rules[last.id if last.counts_why == FAULTY else one.id]}"
        if last.counts_why == EXCLUDED:
            return "excluded: researcher's decision"
        return f"excluded: {last.fault or UNCOUNTED[last.counts_why]}"

    def _outcomes(self, people: Sequence[ParticipantRecord], cell: str) -> Rows:
        """Yield how the first tasks ended in which participants drove."""
        first = [drives[0] for one in people if (drives := self._ended(one.id))]
        ended = by_key((one.outcome, one.id) for one in first)
        for outcome, ids in sorted(ended.items()):
            yield cell, "", f"first task: {table.spoken(outcome)}", table.session_count(ids)


def orders(dataset: Dataset) -> table.Table:
    """Return how many participants had each order of conditions, a check of counterbalancing."""
    conditions = by_key((one.participant, one.condition) for one in dataset.sessions)
    rows = []
    for cell in sorted({one.cell for one in dataset.participants if "-" in one.cell}):
        own = [one.id for one in dataset.participants if one.cell == cell]
        some = [who for who in own if who in conditions]
        whole = [who for who in some if {*conditions[who]} >= {*cell.split("-")}]
        rows.append((cell, *(table.people_count(dataset, ids) for ids in (own, some, whole))))
    head = ("Condition", "Assigned", "With a drive that counts", "With all conditions")
    return table.Table.of("orders", "Participants by order of conditions.", head, rows)


def fault_sides(dataset: Dataset) -> table.Table:
    """Return on which side the fault was for drives that were not completed, counted or not."""
    both = (*dataset.sessions, *dataset.others)
    failed = (one for one in both if one.outcome not in {"", COMPLETED})
    ended = by_key(((one.outcome, one.fault_side), one.id) for one in failed)
    rows = (
        (table.spoken(outcome), side or "nobody", table.session_count(ids))
        for (outcome, side), ids in sorted(ended.items())
    )
    note = (
        "All drives of the task, also those that do not count. Platform: the server was unavailable"
        " when the connection was lost; network: the connection was lost, and the visitor had not"
        " closed the page."
    )
    head = ("Outcome", "Side", "Sessions")
    title = "Sessions that were not completed, by side."
    return table.Table.of("fault-sides", title, head, rows, (note,))


# --- the funnel -----------------------------------------------------------------------------------


def funnel(dataset: Dataset, measured: Sequence[Measured]) -> table.Table:
    """Return how many reached and passed each page and milestone, and the median seconds.
    `measured` are all drives of the task, whether they count or not.
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
    people = table.amount(len(dataset.participants), "participant")
    note = (
        f"{people}, {table.amount(len(measured), 'session')}. Pages are counted by participant,"
        " milestones by session, with the sessions that do not count. Stopped: left, or is still"
        " there. The last page is reached by going on."
    )
    head = ("Page or milestone", "Came", "Went on", "Stopped", "Median (s)")
    return table.Table.of("funnel", "Funnel.", head, rows, (note,))


def _page_row(dataset: Dataset, key: str) -> tuple[object, ...]:
    step = dataset.study.step(key)
    is_end = step is not None and step.is_end
    pages = [page for page in dataset.pages if page.step == key]
    came = {page.participant for page in pages}
    went = {page.participant for page in pages if page.finished or is_end}
    seconds = spread([page.seconds for page in pages if page.finished]).median
    cells = (table.people_count(dataset, ids) for ids in (came, went, came - went))
    return dataset.say(step.title) if step else key, *cells, table.number(seconds, 1)


def _milestone_rows(dataset: Dataset, measured: Sequence[Measured]) -> Rows:
    """Yield each milestone with the seconds since the one before it."""
    stops = {stop.number for course in dataset.study.courses for stop in course.checkpoints} - {0}
    names = [f"checkpoint {n}" for n in sorted(stops)]
    times: dict[str, tuple[float, ...]] = {}
    for one in measured:
        found = one.milestones
        passed = (found.checkpoints.get(n, math.nan) for n in sorted(stops))
        times[one.session.id] = (0.0, found.start, found.motion, *passed, found.docked)
    came = list(times)
    for at, name in enumerate(("first video frame", "first motion", *names, "docked"), start=1):
        went = [one for one in came if math.isfinite(times[one][at])]
        stopped = [one for one in came if not math.isfinite(times[one][at])]
        seconds = spread([times[one][at] - times[one][at - 1] for one in went]).median
        yield name, *map(table.session_count, (came, went, stopped)), table.number(seconds, 1)
        came = went
