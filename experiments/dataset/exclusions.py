"""Who is excluded from the analysis, by which rule: those of the plan, the platform's faults, and
what a researcher decided by hand.

The rules of the plan exclude participants, with all that they did. A drive that the platform ended
is excluded by itself, always, with or without a plan. The time that a questionnaire took is that of
its page, from its first display to its end, by the server's clock.
"""

import statistics
from collections.abc import Iterator, Sequence

from experiments.dataset.levels import PLATFORM, WITHHELD
from experiments.dataset.records import (
    Dataset,
    PageRecord,
    PlanExclusion,
    ResponseRecord,
)
from experiments.definition.plan import AttentionCheck, Speeder, StudyPlan
from surveys.answers import Missing

ATTENTION, SPEEDER, INCOMPLETE = "attention check", "speeder", "incomplete"
OF_PLATFORM, BY_HAND = "platform fault", "researcher's decision"
RULES = {
    ATTENTION: "of the plan: the participant answered an attention check otherwise",
    SPEEDER: "of the plan: the participant answered a questionnaire too fast",
    INCOMPLETE: "of the plan: a condition or a questionnaire of the participant is missing",
    OF_PLATFORM: "the platform ended the session",
    BY_HAND: "a researcher excluded the session",
}
NOT_ASKED = frozenset({Missing.NOT_ASKED, Missing.NOT_REACHED, WITHHELD})  # nothing to judge


def exclusions(dataset: Dataset) -> tuple[PlanExclusion, ...]:
    """Return every exclusion, by participant, from a dataset of those who count before the rules of
    the plan are applied. A participant to whom several rules apply is listed for each.
    """
    plan = dataset.study.plan
    found = [*_of_sessions(dataset)]
    if plan is not None:
        found += _of_participants(dataset, plan)
    return tuple(sorted(found, key=lambda one: (one.participant, one.rule, one.value)))


def excluded_participants(found: Sequence[PlanExclusion]) -> frozenset[str]:
    """Return the participants whom the rules of the plan exclude."""
    return frozenset(one.participant for one in found if not one.session)


def _of_sessions(dataset: Dataset) -> Iterator[PlanExclusion]:
    has_plan = dataset.study.plan is not None
    for one in dataset.others:
        if one.fault_side == PLATFORM:
            yield PlanExclusion(one.participant, OF_PLATFORM, one.fault, one.id, has_plan)
        elif one.excluded:
            yield PlanExclusion(one.participant, BY_HAND, one.excluded, one.id, is_planned=False)


def _of_participants(dataset: Dataset, plan: StudyPlan) -> Iterator[PlanExclusion]:
    for check in plan.attention_checks:
        yield from _failed(dataset, check)
    for speeder in plan.speeders:
        yield from _too_fast(dataset, speeder)
    if plan.incomplete != "keep":
        yield from _incomplete(dataset, with_answers=plan.incomplete == "answers")


# --- attention checks -----------------------------------------------------------------------------


def _failed(dataset: Dataset, check: AttentionCheck) -> Iterator[PlanExclusion]:
    for response in dataset.responses:
        if response.questionnaire != check.questionnaire or not response.finished:
            continue
        given = _given(response, check.item)
        if given is not None and given != check.answer:
            value = f"{check.questionnaire}.{check.item}: {given}, right is {check.answer}"
            yield PlanExclusion(response.participant, ATTENTION, value)


def _given(response: ResponseRecord, item: str) -> str | None:
    """Return what was answered to an item, as text; None where it was not asked."""
    if item in response.values:
        return as_answer(response.values[item])
    reason = response.missing.get(item)
    return None if reason is None or reason in NOT_ASKED else "no answer"


def as_answer(value: object) -> str:
    """Return a stored value as the plan writes it: a number, a word, or words with commas."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


# --- speeders -------------------------------------------------------------------------------------


def _too_fast(dataset: Dataset, rule: Speeder) -> Iterator[PlanExclusion]:
    pages = _answered_pages(dataset, rule.questionnaire)
    limit, in_words = _limit(rule, pages)
    for page in pages:
        if page.seconds < limit:
            value = f"{rule.questionnaire}: {page.seconds:.1f} s, less than {in_words}"
            yield PlanExclusion(page.participant, SPEEDER, value)


def _answered_pages(dataset: Dataset, questionnaire: str) -> list[PageRecord]:
    """Return the finished pages of a questionnaire, without those about a drive that does not
    count.
    """
    steps = {one.key for one in dataset.study.asking if one.questionnaire == questionnaire}
    other = {one.id for one in dataset.others}
    return [
        one
        for one in dataset.pages
        if one.finished and one.step in steps and one.session not in other
    ]


def _limit(rule: Speeder, pages: Sequence[PageRecord]) -> tuple[float, str]:
    """Return the least seconds that are allowed, as a number and in words."""
    limit = rule.seconds or 0.0
    if rule.median_share is None or not pages:
        return limit, f"{limit:g} s"
    median = statistics.median(one.seconds for one in pages)
    share = rule.median_share * median
    if share <= limit:
        return limit, f"{limit:g} s"
    return share, f"{share:.1f} s ({rule.median_share:g} of the median of {median:.1f} s)"


# --- incomplete cases -----------------------------------------------------------------------------


def _incomplete(dataset: Dataset, *, with_answers: bool) -> Iterator[PlanExclusion]:
    for person in dataset.participants:
        if person.withdrawn:
            continue
        lacking = list(_lacking(dataset, person.id, person.cell, with_answers=with_answers))
        if lacking:
            yield PlanExclusion(person.id, INCOMPLETE, "; ".join(lacking))


def _lacking(dataset: Dataset, who: str, cell: str, *, with_answers: bool) -> Iterator[str]:
    if not cell:
        yield "never assigned to a condition"
        return
    drives = [one for one in dataset.sessions if one.participant == who]
    driven = {one.condition for one in drives}
    for key in cell.split("-"):
        if key not in driven:
            yield f"no drive of {key}"
        elif with_answers:
            yield from _unanswered(
                dataset, who, key, {one.id for one in drives if one.condition == key}
            )


def _unanswered(dataset: Dataset, who: str, condition: str, sessions: set[str]) -> Iterator[str]:
    for step in dataset.study.asking:
        answered = any(
            one.finished
            and one.questionnaire == step.questionnaire
            and (not step.repeat or one.session in sessions)
            for one in dataset.responses
            if one.participant == who
        )
        if not answered:
            yield f"no answers to {step.questionnaire} ({condition})"
