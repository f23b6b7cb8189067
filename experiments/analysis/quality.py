"""The quality flags of a dataset, for researchers, exports, and the rules of a plan.

Answers: below 1 s an item they are not read (Wood, Harms, Lowman & DeSimone 2017, "Response speed
and response consistency as mutually validating indicators of data quality in online samples",
Social Psychological and Personality Science 8(4)); a third of the median time is the usual relative
limit (Greszki, Meyer & Schoen 2015, Public Opinion Quarterly 79(2)). Long strings of one answer:
Johnson 2005, Journal of Research in Personality 39(1).

Driving: the thresholds were chosen for this platform and are not from the literature. A person's
inputs vary by half of their length and more, whereas a program that holds each input for the same
time differs only by the sampling of the states (about 5 Hz).
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from statistics import median

import numpy as np

from experiments.dataset.columns import Columns, Floats
from experiments.dataset.grouping import by_key
from experiments.dataset.record_quality import FROZEN_SHARE, frozen_share
from experiments.dataset.records import Dataset, ResponseRecord, SessionRecord
from experiments.definition.recruitment.quality_flags import Flag, Grade, QualityFlag
from experiments.definition.recruitment.recruiting import names_answer
from surveys.definition import Definition

CROWD = 3  # participants on one network
SECONDS_PER_ITEM = 1.0
MEDIAN_SHARE = 1 / 3
LEAST_OTHERS = 10  # responses, before their median is a standard
LEAST_ITEMS = 5  # on one scale, before equal answers say anything
SAW_SECONDS = 10.0  # of video, before standing still is a decision
LEAST_INPUTS = 12
REGULAR, VERY_REGULAR = 0.15, 0.08  # coefficients of variation of the lengths of inputs
STILL = 0.01  # m/s, rad/s
FROZEN = ((0.5, Grade.SERIOUS), (FROZEN_SHARE, Grade.DOUBTFUL), (0.05, Grade.NOTE))


def flags_of(dataset: Dataset, participants: Iterable[str] | None = None) -> tuple[Flag, ...]:
    """Return the flags of a whole study's dataset (some compare participants), by participant, the
    most serious first. With `participants`, codes, only the states of their sessions are read.
    """
    wanted = None if participants is None else set(participants)
    found = [*answer_flags(dataset), *network_flags(dataset)]
    for session in dataset.sessions:
        if wanted is None or session.participant in wanted:
            found += driving_flags(dataset, session)
    kept = (one for one in found if wanted is None or one.participant in wanted)
    return tuple(sorted(kept, key=lambda one: (one.participant, -one.grade, one.name, one.value)))


def network_flags(dataset: Dataset) -> Iterator[Flag]:
    """Flag participants on one network, which people of one home or university also share."""
    people: dict[str, set[str]] = {}
    for session in dataset.sessions:
        if session.network and session.kind == "participant":
            people.setdefault(session.network, set()).add(session.participant)
    for codes in people.values():
        if len(codes) > 1:
            grade = Grade.NOTE if len(codes) < CROWD else Grade.DOUBTFUL
            value = f"{len(codes)} participants on one network"
            yield from (Flag(code, "same_network", grade, value) for code in sorted(codes))


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
    for name in dataset.study.asked:
        answered = dataset.answered_pages(name)
        times = [page.seconds for page, _response in answered]
        for page, response in answered:
            items = len(response.values) if response.finished else 0
            grade = speeding(page.seconds, items, times)
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
    asked = (one for one in definition.questions() if one.score_values)
    given = (one for one in asked if one.key in response.values)
    scales = by_key((tuple(one.score_values), one.key) for one in given)
    for points, keys in scales.items():
        values = [response.values[key] for key in keys if response.values[key] is not None]
        middle = (points[0] + points[-1]) / 2
        has_reversed = bool(set(keys) & set(definition.reversed))
        grade = straight_lining(values, has_reversed=has_reversed, middle=middle)
        if grade is not None:
            value = f"{response.questionnaire}: {len(values)} answers, all {values[0]}"
            yield Flag(response.participant, "straight_lining", grade, value, response.session)


def driving_flags(dataset: Dataset, session: SessionRecord) -> Iterator[Flag]:
    """Yield the flags of one session, from its states and network samples; practice has none."""
    if session.practice:
        return
    found: tuple[tuple[QualityFlag, tuple[Grade, str] | None], ...] = (
        ("never_moved", never_moved(session)),
        ("regular_input", regular_input(dataset.states(session.id))),
        ("frozen_video", frozen_video(dataset.network(session.id), session)),
    )
    for name, one in found:
        if one is not None:
            grade, value = one
            yield Flag(session.participant, name, grade, value, session.id)


def never_moved(session: SessionRecord) -> tuple[Grade, str] | None:
    """Flag a driver who saw the video and never moved the robot, if the drive was not ended by
    anything but the driver.
    """
    seen = session.ended - session.first_frame
    has_moved = math.isfinite(session.first_motion)
    if has_moved or session.fault_side not in {"", "visitor"} or not seen >= SAW_SECONDS:
        return None
    return Grade.SERIOUS, f"saw the video for {seen:.0f} s, never moved"


def regular_input(states: Columns) -> tuple[Grade, str] | None:
    """Flag requested motion that changed in steps of the same length, as a program's does."""
    lengths = input_lengths(states["stamp"], states["asked_linear"], states["asked_angular"])
    if len(lengths) < LEAST_INPUTS:
        return None
    variation = float(np.std(lengths) / np.mean(lengths))
    if variation > REGULAR:
        return None
    grade = Grade.SERIOUS if variation <= VERY_REGULAR else Grade.DOUBTFUL
    mean = float(np.mean(lengths))
    return grade, f"{len(lengths)} inputs of {mean:.2f} s each, varying by {variation:.0%}"


def input_lengths(stamps: Floats, linear: Floats, angular: Floats) -> Floats:
    """Return how many seconds each input lasted: a time in which the requested motion kept its
    direction (forward, back, left, right, or a combination), without the first and the last one,
    which the record may cut. All are (n,): seconds, m/s and rad/s, NaN without a request.
    """
    known = np.nan_to_num([linear, angular])
    directions = np.array([3.0, 1.0]) @ (np.sign(known) * (np.abs(known) > STILL))
    edges = np.flatnonzero(np.diff(directions)) + 1  # starts of all but the first input
    lengths = np.diff(stamps[edges])
    return np.asarray(lengths[directions[edges[:-1]] != 0.0])


def frozen_video(network: Columns, session: SessionRecord) -> tuple[Grade, str] | None:
    """Flag a drive in which the page showed no new frame in too many seconds."""
    share = frozen_share(network, session)
    grade = next((grade for limit, grade in FROZEN if share >= limit), None)
    return None if grade is None else (grade, f"no new frame in {share:.0%} of the seconds")
