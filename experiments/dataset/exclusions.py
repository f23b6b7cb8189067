"""Exclusions from the analysis, with the rule of each: those of the plan, the platform's faults,
and what a researcher decided by hand.

The rules of the plan exclude participants, with all that they did, or a drive for a fault of its
record. Rules about participants apply to the whole study: a public dataset, which is a part of it,
has their result. A drive that the platform ended is excluded by itself, always, with or without a
plan. The time that a questionnaire took is that of its page, from its first display to its end, by
the server's clock.
"""

import statistics
from collections.abc import Collection, Iterator, Sequence

from experiments.dataset import levels
from experiments.dataset.record_quality import excluding_faults
from experiments.dataset.records import Dataset, PageRecord, PlanExclusion, ResponseRecord
from experiments.definition.plan import AttentionCheck, Speeder
from surveys.answers import Missing

NOT_ASKED = frozenset({Missing.NOT_ASKED, Missing.NOT_REACHED, levels.WITHHELD})  # nothing to judge


def exclusions(dataset: Dataset) -> tuple[PlanExclusion, ...]:
    """Return every exclusion, by participant, from a dataset of those who count before the rules of
    the plan are applied. A participant to whom several rules apply is listed for each.
    """
    found = [*_of_sessions(dataset), *_of_participants(dataset)]
    return tuple(sorted(found, key=lambda one: (one.participant, one.rule, one.value)))


def excluded_participants(
    found: Sequence[PlanExclusion], rules: Collection[str] = frozenset(levels.RULES)
) -> frozenset[str]:
    """Return the participants whom some rules exclude with all their sessions."""
    return frozenset(one.participant for one in found if not one.session and one.rule in rules)


def _of_sessions(dataset: Dataset) -> Iterator[PlanExclusion]:
    has_plan = dataset.study.plan is not None
    for one in dataset.others:
        if one.fault_side == levels.PLATFORM:
            yield PlanExclusion(one.participant, one.id, levels.OF_PLATFORM, one.fault, has_plan)
        elif one.counts_why == levels.FAULTY:
            for name, value in excluding_faults(dataset, one).items():
                yield PlanExclusion(one.participant, one.id, f"{levels.FAULT}: {name}", value)
        elif one.excluded:
            yield PlanExclusion(
                one.participant, one.id, levels.BY_HAND, one.excluded, planned=False
            )


def _of_participants(dataset: Dataset) -> Iterator[PlanExclusion]:
    if dataset.whole is not None:
        there = {one.id for one in dataset.participants}
        yield from (one for one in dataset.whole.exclusions if one.participant in there)
        return
    plan = dataset.study.plan
    if plan is None:
        return
    for check in plan.attention_checks:
        yield from _failed(dataset, check)
    for speeder in plan.speeders:
        yield from _too_fast(dataset, speeder)
    if plan.incomplete != "keep":
        drives = (*dataset.sessions, *dataset.others)
        exposed = {one.participant for one in drives if one.exposed}
        judged = exposed - {one.participant for one in drives if not one.outcome}
        for person in dataset.participants:
            lacking = list(_lacking(dataset, person.id, person.cell))
            if lacking and person.id in judged:
                yield PlanExclusion(person.id, "", levels.INCOMPLETE, "; ".join(lacking))


def _failed(dataset: Dataset, check: AttentionCheck) -> Iterator[PlanExclusion]:
    for response in dataset.responses:
        if response.questionnaire != check.questionnaire or not response.finished:
            continue
        given = _given(response, check.item)
        if given is not None and given != check.answer:
            value = f"{check.questionnaire}.{check.item}: {given}, right is {check.answer}"
            yield PlanExclusion(response.participant, "", levels.ATTENTION, value)


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


def _too_fast(dataset: Dataset, rule: Speeder) -> Iterator[PlanExclusion]:
    """Yield the finished pages that were too fast, of responses that count. Each step that asks the
    questionnaire has its own median.
    """
    for variable, step in dataset.study.asked.items():
        if step.questionnaire != rule.questionnaire:
            continue
        pages = [page for page, _response in dataset.answered_pages(variable)]
        limit, in_words = _limit(rule, pages)
        for page in pages:
            if page.seconds < limit:
                value = f"{variable}: {page.seconds:.1f} s, less than {in_words}"
                yield PlanExclusion(page.participant, "", levels.SPEEDER, value)


def _limit(rule: Speeder, pages: Sequence[PageRecord]) -> tuple[float, str]:
    limit = rule.seconds or 0.0
    if rule.median_share is None or not pages:
        return limit, f"{limit:g} s"
    median = statistics.median(one.seconds for one in pages)
    share = rule.median_share * median
    if share <= limit:
        return limit, f"{limit:g} s"
    return share, f"{share:.1f} s ({rule.median_share:g} of the median of {median:.1f} s)"


def _lacking(dataset: Dataset, who: str, cell: str) -> Iterator[str]:
    """Yield the drives that a participant lacks, and the answers where the plan requires them."""
    plan = dataset.study.plan
    drives = [one for one in dataset.sessions if one.participant == who]
    for key in filter(None, cell.split("-")):
        sessions = {one.id for one in drives if one.condition == key}
        if not sessions:
            yield f"no drive of {key}"
        elif plan is not None and plan.incomplete == "answers":
            yield from _unanswered(dataset, who, key, sessions)


def _unanswered(dataset: Dataset, who: str, condition: str, sessions: set[str]) -> Iterator[str]:
    for variable, step in dataset.study.asked.items():
        own = (one for one in dataset.answers_to(variable) if one.participant == who)
        if not any(one.finished and (not step.repeat or one.session in sessions) for one in own):
            yield f"no answers to {variable} ({condition})"
