"""The names of quality flags (experiments/analysis/quality/): signs that a participant did not take
part as intended. A flag alone excludes no participant; a plan can name flags as rules of exclusion.
"""

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
