"""Quality flags: signs that a participant did not take part as intended.

A flag is graded and excludes no participant by itself. A plan can name flags as rules of exclusion;
experiments/analysis/quality.py finds them.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

AnswerFlag = Literal["attention_check", "speeding", "straight_lining"]
DrivingFlag = Literal["never_moved", "regular_input", "frozen_video"]
QualityFlag = Literal[AnswerFlag, DrivingFlag, "same_network", "same_id"]


class Grade(IntEnum):
    """1 happens to attentive participants, 2 is worth a look, 3 is hardly compatible with taking
    part as intended.
    """

    NOTE = 1
    DOUBTFUL = 2
    SERIOUS = 3


@dataclass(frozen=True)
class Flag:
    """A finding about a participant (by code), as `value`; `session` if in a single one."""

    participant: str
    name: QualityFlag
    grade: Grade
    value: str
    session: str = ""
