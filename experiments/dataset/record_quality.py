"""The faults of the record of a drive, by the requirements of the study (`Quality`): all are
reported, and those that the plan names exclude the drive (`StudyPlan.faults`).
"""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from experiments.dataset.columns import Columns
from experiments.dataset.levels import FAULTS
from experiments.dataset.records import Dataset, SessionRecord
from experiments.dataset.states import NO_STATES
from experiments.dataset.trajectory import Trajectory
from experiments.definition.plan import Fault
from experiments.definition.schema import Quality

OF_SESSION = frozenset({"condition", "operator"})  # known without the states
FROZEN_SHARE = 0.2
LEAST_SAMPLES = 20  # seconds of video, before the share of frozen ones says anything


def record_numbers(session: SessionRecord, track: Trajectory) -> dict[str, float]:
    """Return the metrics of a drive's record, from all of its states."""
    gaps, missing = track.gaps(), max(session.missing, track.missing())
    offsets = np.abs(track.states["clock_offset"])
    offsets = offsets[np.isfinite(offsets)]
    has_gaps = len(track) > 1
    return {
        "rate": track.rate(),
        "gaps": float(len(gaps)) if has_gaps else math.nan,
        "longest_gap": float(gaps.max(initial=0.0)) if has_gaps else math.nan,
        "missing_states": float(missing) if missing or len(track) else math.nan,
        "clock_offset": float(offsets.max()) if offsets.size else math.nan,
    }


def frozen_share(network: Columns, session: SessionRecord) -> float:
    """Return the share of the seconds of video in which the page showed no new frame; NaN if they
    are too few.
    """
    stamps = network["stamp"]
    rates = network["fps"][(stamps >= session.first_frame) & ~(stamps > session.ended)]
    rates = rates[np.isfinite(rates)]
    return float(np.mean(rates == 0.0)) if len(rates) >= LEAST_SAMPLES else math.nan


def faults(
    session: SessionRecord, values: Mapping[str, float], rules: Quality
) -> Iterator[tuple[Fault, str]]:
    """Yield the faults of a record, each with a sentence, from the numbers of `record_numbers`. A
    session without a video frame may lack states.
    """
    rate, gap, offset = values["rate"], values["longest_gap"], values["clock_offset"]
    if session.exposed and math.isnan(rate):
        yield "no_states", "The robot was driven, but there are no states."
    elif rate < rules.least_sample_rate:
        least = f"at least {rules.least_sample_rate:g} are asked for"
        yield "rate", f"{rate:.2f} states a second; {least}."
    if gap > rules.longest_gap:
        yield "gap", f"{gap:.1f} s without a state; at most {rules.longest_gap:g} s are allowed."
    if session.exposed and not math.isnan(rate) and math.isnan(offset):
        yield "clock_unknown", "The clock offset was never measured."
    elif offset > rules.largest_clock_offset:
        most = f"at most {rules.largest_clock_offset:g} s are allowed"
        yield "clock", f"The clocks differed by {offset:.2f} s; {most}."
    if session.mismatch:
        yield "condition", f"Not applied as assigned: {session.mismatch}."
    if session.operator:
        yield "operator", "An operator intervened."


def excluding_faults(dataset: Dataset, session: SessionRecord) -> dict[str, str]:
    """Return the faults of a drive for which the plan excludes it, each with a sentence."""
    named = set(dataset.study.plan.faults) if dataset.study.plan is not None else set()
    if not named:
        return {}
    states = dataset.states(session.id) if named - OF_SESSION else NO_STATES
    numbers = record_numbers(session, Trajectory.of(states))
    found: dict[str, str] = dict(faults(session, numbers, dataset.study.quality))
    if "frozen_video" in named:
        share = frozen_share(dataset.network(session.id), session)
        if share >= FROZEN_SHARE:
            found["frozen_video"] = f"No new video frame in {share:.0%} of the seconds."
    return {name: found[name] for name in FAULTS if name in named and name in found}
