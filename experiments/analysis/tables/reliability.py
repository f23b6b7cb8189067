"""Can a session's record be trusted? By rules that were frozen with the study; what fails is named,
nothing is deleted.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from experiments.analysis.metrics.sessions import Measured
from experiments.definition.schema import Quality

# The words of the rules.
PROBLEMS = {
    "no_states": "the robot was driven, and there are no states",
    "rate": "fewer states a second than the study asks for",
    "gap": "a longer time without a state than the study allows",
    "clock_unknown": "the clock offset was never measured",
    "clock": "the clocks differed by more than the study allows",
    "condition": "the condition was not applied as assigned",
    "operator": "an operator intervened",
}


@dataclass(frozen=True)
class QualityVerdict:
    """`problems` has a word and a sentence each; the record is good without any."""

    problems: tuple[tuple[str, str], ...]

    @property
    def good(self) -> bool:
        """Tell whether nothing was found."""
        return not self.problems


def judge(measured: Measured, rules: Quality) -> QualityVerdict:
    """Return the verdict on a session; one that never moved is judged by what it has."""
    return QualityVerdict(tuple(_problems(measured, rules)))


def _problems(measured: Measured, rules: Quality) -> Iterator[tuple[str, str]]:
    values, session = measured.values, measured.session
    rate, gap, offset = values["rate"], values["longest_gap"], values["clock_offset"]
    if session.exposed and math.isnan(rate):
        yield "no_states", "The robot was driven, but there are no states."
    elif rate < rules.least_sample_rate:
        yield (
            "rate",
            f"{rate:.2f} states a second; at least {rules.least_sample_rate:g} are asked for.",
        )
    if gap > rules.longest_gap:
        yield "gap", f"{gap:.1f} s without a state; at most {rules.longest_gap:g} s are allowed."
    if session.exposed and not math.isnan(rate) and math.isnan(offset):
        yield "clock_unknown", "The clock offset was never measured."
    elif offset > rules.largest_clock_offset:
        yield (
            "clock",
            (
                f"The clocks differed by {offset:.2f} s; at most {rules.largest_clock_offset:g} s"
                " are allowed."
            ),
        )
    if rules.condition_applied and session.mismatch:
        yield "condition", f"Not applied as assigned: {session.mismatch}."
    if rules.operator_absent and session.operator:
        yield "operator", "An operator intervened."
