"""A bot's log: its pages and how long it was on each, its drives, and where it got stuck."""

from dataclasses import dataclass, field


@dataclass
class Leg:
    """One drive. `seconds` from the first image; `passed` the numbers of checkpoints;
    `circumstances` what a driver sees of a condition.
    """

    seconds: float = 0.0
    waited: float = 0.0
    outcome: str = ""
    reason: str = ""
    passed: tuple[int, ...] = ()
    doors: tuple[str, ...] = ()
    closed: tuple[str, ...] = ()
    cues: list[str] = field(default_factory=list)
    circumstances: dict[str, str] = field(default_factory=dict)
    session: str = ""
    no_route: str = ""
    refused: dict[str, int] = field(default_factory=dict)
    pictures: int = 0
    round_trip: float | None = None


@dataclass
class PageVisit:
    """One page: its heading, when it opened and for how long (seconds), the number of its words and
    questions, and whether it `drives` the robot.
    """

    heading: str
    path: str
    at: float
    seconds: float = 0.0
    words: int = 0
    questions: int = 0
    drives: bool = False


@dataclass
class Diary:
    """Everything of one bot. `stuck` is a sentence when the study led nowhere, empty otherwise."""

    number: int
    ending: str
    user: str = ""
    code: str = ""
    entries: list[PageVisit] = field(default_factory=list)
    legs: list[Leg] = field(default_factory=list)
    answered: dict[str, str] = field(default_factory=dict)
    stuck: str = ""
    done: bool = False
