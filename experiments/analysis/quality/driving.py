"""Quality flags from driving telemetry: never moved, perfectly regular input, frozen video.

The thresholds were chosen for this platform and are not from the literature: a person's inputs vary
by half of their length and more, whereas a program that holds each input for the same time differs
only by the sampling of the states (about 5 Hz).
"""

import math
from collections.abc import Iterator

import numpy as np

from experiments.dataset.columns import Columns, Floats
from experiments.dataset.records import Dataset, SessionRecord
from experiments.definition.recruitment.quality_flags import Flag, Grade, QualityFlag

SAW_SECONDS = 10.0  # of video, before standing still is a decision
LEAST_INPUTS = 12
REGULAR, VERY_REGULAR = 0.15, 0.08  # coefficients of variation of the lengths of inputs
STILL = 0.01  # m/s, rad/s
LEAST_SAMPLES = 20  # seconds
FROZEN = ((0.5, Grade.SERIOUS), (0.2, Grade.DOUBTFUL), (0.05, Grade.NOTE))


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
    stamps = network["stamp"]
    during = (stamps >= session.first_frame) & ~(stamps > session.ended)
    rates = network["fps"][during]
    rates = rates[np.isfinite(rates)]
    if len(rates) < LEAST_SAMPLES:
        return None
    share = float(np.mean(rates == 0.0))
    grade = next((grade for limit, grade in FROZEN if share >= limit), None)
    return None if grade is None else (grade, f"no new frame in {share:.0%} of {len(rates)} s")
