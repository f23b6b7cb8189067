"""A quality flag: what was found, about whom, and how serious it is."""

from dataclasses import dataclass

from experiments.definition.recruitment.quality_flags import Grade, QualityFlag


@dataclass(frozen=True)
class Flag:
    """A quality flag of a participant.

    Attributes:
        participant: the participant's code.
        name: which flag.
        grade: how serious it is.
        value: what was found, in words and figures.
        session: the session's code; empty where the flag is about no single one.
    """

    participant: str
    name: QualityFlag
    grade: Grade
    value: str
    session: str = ""
