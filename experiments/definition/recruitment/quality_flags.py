"""Quality flags: signs that a participant did not take part as meant.

A flag is graded and excludes no participant by itself. A plan can name flags as rules of exclusion;
experiments/analysis/quality/ finds them.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, get_args

QualityFlag = Literal[
    "attention_check",
    "speeding",
    "straight_lining",
    "never_moved",
    "regular_input",
    "frozen_video",
    "same_network",
    "same_id",
]
QUALITY_FLAGS: tuple[QualityFlag, ...] = get_args(QualityFlag)


class Grade(IntEnum):
    """How serious a flag is: 1 happens to attentive participants as well, 2 is worth a look, 3 is
    hardly compatible with taking part as meant.
    """

    NOTE = 1
    DOUBTFUL = 2
    SERIOUS = 3


@dataclass(frozen=True)
class Flag:
    """A flag of a participant, by code: what was found (`value`, in words and figures), and in
    which session, if it is about a single one.
    """

    participant: str
    name: QualityFlag
    grade: Grade
    value: str
    session: str = ""
