"""Quality flags from answers: failed attention checks, speeding and straight-lining.

Thresholds: below 1 s an item answers are not read (Wood, Harms, Lowman & DeSimone 2017, "Response
speed and response consistency as mutually validating indicators of data quality in online
samples", Social Psychological and Personality Science 8(4)); a third of the median time is the
usual relative limit (Greszki, Meyer & Schoen 2015, Public Opinion Quarterly 79(2)). Long strings of
one answer: Johnson 2005, Journal of Research in Personality 39(1).
"""

import math
from collections.abc import Iterator, Sequence
from statistics import median

from experiments.dataset.records import Dataset, ResponseRecord
from experiments.definition.recruitment.quality_flags import Flag, Grade
from experiments.definition.recruitment.recruiting import names_answer
from surveys.definition import Definition

SECONDS_PER_ITEM = 1.0
MEDIAN_SHARE = 1 / 3
LEAST_OTHERS = 10  # responses, before their median is a standard
LEAST_ITEMS = 5  # on one scale, before equal answers say anything


def answer_flags(dataset: Dataset) -> Iterator[Flag]:
    yield from _speeding(dataset)
    plan = dataset.study.plan
    for check in plan.attention_checks if plan is not None else ():
        for response in dataset.responses:
            value = response.values.get(check.item)
            is_asked = response.questionnaire == check.questionnaire and response.finished
            if is_asked and value is not None and not names_answer([check.answer], value):
                name = f"{check.questionnaire}.{check.item}"
                yield Flag(response.participant, "attention_check", Grade.SERIOUS, name)
    for response in dataset.responses:
        definition = dataset.questionnaire(response.questionnaire)
        if response.finished and definition is not None:
            yield from _straight_lining(response, definition)


def speeding(seconds: float, items: int, others: Sequence[float]) -> Grade | None:
    """Grade the seconds for `items` answers; None if enough. `others` are everyone's times."""
    if not math.isfinite(seconds) or not items:
        return None
    if seconds < items * SECONDS_PER_ITEM:
        return Grade.SERIOUS
    if len(others) >= LEAST_OTHERS and seconds < median(others) * MEDIAN_SHARE:
        return Grade.DOUBTFUL
    return None


def _speeding(dataset: Dataset) -> Iterator[Flag]:
    asked = {step.key: step.questionnaire for step in dataset.study.asking}
    pages = [one for one in dataset.pages if one.finished and one.step in asked]
    times: dict[str, list[float]] = {}
    for page in pages:
        times.setdefault(asked[page.step], []).append(page.seconds)
    answered = {
        (one.participant, one.questionnaire, one.session): len(one.values)
        for one in dataset.responses
        if one.finished
    }
    for page in pages:
        name = asked[page.step]
        items = answered.get((page.participant, name, page.session), 0)
        grade = speeding(page.seconds, items, times[name])
        if grade is not None:
            value = f"{name}: {items} answers in {page.seconds:.1f} s"
            yield Flag(page.participant, "speeding", grade, value, page.session)


def straight_lining(
    values: Sequence[float], *, has_reversed: bool, middle: float | None = None
) -> Grade | None:
    """Grade equal answers to all items of a scale; None if they differ or are too few. Equal
    answers to opposite items contradict each other, except in the `middle`.
    """
    if len(values) < LEAST_ITEMS or len(set(values)) > 1:
        return None
    is_contradiction = has_reversed and values[0] != middle
    return Grade.DOUBTFUL if is_contradiction else Grade.NOTE


def _straight_lining(response: ResponseRecord, definition: Definition) -> Iterator[Flag]:
    scales: dict[tuple[int, ...], list[str]] = {}
    for question in definition.questions():
        if question.score_values and question.key in response.values:
            scales.setdefault(tuple(question.score_values), []).append(question.key)
    for points, keys in scales.items():
        values = [response.values[key] for key in keys if response.values[key] is not None]
        middle = (points[0] + points[-1]) / 2
        has_reversed = bool(set(keys) & set(definition.reversed))
        grade = straight_lining(values, has_reversed=has_reversed, middle=middle)
        if grade is not None:
            value = f"{response.questionnaire}: {len(values)} answers, all {values[0]}"
            yield Flag(response.participant, "straight_lining", grade, value, response.session)
