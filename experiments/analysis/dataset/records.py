"""A study's records as plain data: all that tables and figures are made of, wherever it was read
from.

States and network samples are numbers in columns, read a session at a time, because those of a
thousand sessions do not fit beside each other.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from experiments.analysis.dataset import counting
from experiments.analysis.dataset.columns import NETWORK, STATES, Column
from experiments.analysis.dataset.exclusions import PlanExclusion, excluded_participants
from experiments.analysis.dataset.levels import PLATFORM, Kind
from experiments.definition.publication import PublicationDetails
from experiments.definition.schema import Course, StudyDefinition
from robots.api.floorplan import FloorPlan
from surveys.definition import Definition
from surveys.documents import spoken

Floats = npt.NDArray[np.float64]
COMPLETED = "completed"
# The drives that count, and a sensitivity analysis: those and the excluded ones. Both are the names
# of folders in a report.
COUNTING, EVERY = "counting", "all"


class RobotRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A robot of the study; `series` is what courses are made for, `facts` are the rows of Table 1,
    by name.
    """

    name: str
    title: str
    series: str
    facts: dict[str, str] = {}


class FreezeRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """When the definition of a study was frozen, and what its site knew then.

    `sha256` is that of the definition; `frozen_at` is in UTC, to the minute, and empty for a draft.
    `before_data` tells whether the first participant of this version came later (None for a draft);
    when that was is not told, because it would be a date of a person. `earlier` counts the
    participants of earlier versions who had come before. `deviations` is what researchers wrote
    about deviations from the plan, `software` the version of the server's software that wrote this.
    """

    sha256: str
    frozen_at: str = ""
    before_data: bool | None = None
    earlier: int = 0
    deviations: str = ""
    software: str = ""


@dataclass(frozen=True)
class ParticipantRecord:
    """A row of the participants (columns.PARTICIPANTS); an age that was not told is NaN."""

    id: str
    kind: Kind = "participant"
    age: float = float("nan")
    age_band: str = ""
    cell: str = ""
    first_cell: str = ""
    draws: int = 0
    stage: str = ""
    place: str = ""
    reached: str = ""
    left: str = ""
    finished: bool = False
    withdrawn: bool = False


@dataclass(frozen=True)
class SessionRecord:
    """A row of the sessions (columns.SESSIONS); a time that never came is NaN. `counts_why` is set
    by experiments/analysis/dataset/counting.py; in datasets of earlier releases `visit` is 0.
    """

    id: str
    participant: str
    robot: str
    kind: Kind = "participant"
    number: int = 1
    visit: int = 0
    round: int = 0
    practice: bool = False
    counts_why: str = ""
    site: str = ""
    condition: str = ""
    mismatch: str = ""
    control_way: str = ""
    assist: str = ""
    doors_closed: tuple[str, ...] = ()
    control_network: str = ""
    video_network: str = ""
    control_applied: str = ""
    video_applied: str = ""
    outcome: str = ""
    reason: str = ""
    os: str = ""
    browser: str = ""
    network: str = ""
    first_frame: float = float("nan")
    first_motion: float = float("nan")
    ended: float = float("nan")
    began_x: float = float("nan")
    began_y: float = float("nan")
    began_theta: float = float("nan")
    began_docked: float = float("nan")
    began_charge: float = float("nan")
    ended_x: float = float("nan")
    ended_y: float = float("nan")
    ended_theta: float = float("nan")
    ended_docked: float = float("nan")
    ended_charge: float = float("nan")
    docked_seconds: float = float("nan")
    dock_contacts: float = float("nan")
    operator: bool = False
    missing: int = 0
    excluded: str = ""
    fault_side: str = ""
    fault_part: str = ""
    server_version: str = ""
    agent_version: str = ""
    adapter_version: str = ""
    driver_version: str = ""
    metrics_version: str = ""
    definition_version: str = ""

    @property
    def counts(self) -> bool:
        """Whether it counts in results."""
        return not self.counts_why

    @property
    def uncounted_because(self) -> str:
        """Why it does not count, in words; empty when it counts."""
        own = {counting.PLATFORM_FAULT: self.fault, counting.EXCLUDED: self.excluded}
        return own.get(self.counts_why) or counting.REASONS.get(self.counts_why, "")

    @property
    def fault(self) -> str:
        """The platform's fault that ended it; empty when none did."""
        if self.fault_side != PLATFORM:
            return ""
        part = self.fault_part.replace("_", " ")
        return f"platform fault: {part} away" if part else "platform fault"

    @property
    def drove(self) -> bool:
        """Whether a velocity of the visitor ever moved the robot."""
        return not math.isnan(self.first_motion)

    @property
    def exposed(self) -> bool:
        """Whether the page showed a video frame of the task; who drove has seen one."""
        return self.drove or not math.isnan(self.first_frame)


@dataclass(frozen=True)
class EventRecord:
    """A row of the events (columns.EVENTS)."""

    session: str
    stamp: float
    source: str
    type: str
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class PageRecord:
    """A row of the pages (columns.PAGES); `seconds` is NaN for one that was left."""

    participant: str
    step: str
    session: str = ""
    seconds: float = float("nan")
    finished: bool = True


@dataclass(frozen=True)
class ResponseRecord:
    """A filled-in questionnaire; `missing` tells why an item has no value."""

    id: str
    questionnaire: str
    participant: str
    values: Mapping[str, Any]
    version: int = 1
    session: str = ""
    finished: bool = True
    missing: Mapping[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


class Columns:
    """Numbers in named columns: `columns["x"]` is (n,)."""

    def __init__(self, layout: tuple[Column, ...], values: Floats) -> None:
        if values.ndim != 2 or values.shape[1] != len(layout):
            raise ValueError(
                f"expected {len(layout)} columns, not an array of shape {values.shape}"
            )
        self.layout = layout
        self.values = values
        self._at = {column.name: index for index, column in enumerate(layout)}

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, name: str) -> Floats:
        return self.values[:, self._at[name]]


def columns_of(layout: tuple[Column, ...], **given: npt.ArrayLike) -> Columns:
    """Return columns of the same length from those that are given; the others are NaN."""
    length = len(np.atleast_1d(next(iter(given.values())))) if given else 0
    values = np.full((length, len(layout)), np.nan)
    at = {column.name: index for index, column in enumerate(layout)}
    for name, numbers in given.items():
        values[:, at[name]] = numbers
    return Columns(layout, values)


NO_STATES = columns_of(STATES)
NO_NETWORK = columns_of(NETWORK)
NO_PUBLICATION = PublicationDetails()


@dataclass(frozen=True)
class Dataset:
    """A study and all that was recorded of it. `states` and `network` read those of a session,
    which may have none. Datasets of earlier releases have no `freeze`.

    In a dataset of what counts (`counting`), `others` are the drives of the task that do not, and
    `exclusions` everything that was excluded, or in a sensitivity analysis would have been.
    """

    study: StudyDefinition
    robots: tuple[RobotRecord, ...] = ()
    participants: tuple[ParticipantRecord, ...] = ()
    sessions: tuple[SessionRecord, ...] = ()
    events: tuple[EventRecord, ...] = ()
    pages: tuple[PageRecord, ...] = ()
    responses: tuple[ResponseRecord, ...] = ()
    questionnaires: tuple[Definition, ...] = ()
    plans: Mapping[str, FloorPlan] = field(default_factory=dict)
    states: Callable[[str], Columns] = lambda _: NO_STATES
    network: Callable[[str], Columns] = lambda _: NO_NETWORK
    others: tuple[SessionRecord, ...] = ()
    exclusions: tuple[PlanExclusion, ...] = ()
    is_with_excluded: bool = False
    freeze: FreezeRecord | None = None
    publication: PublicationDetails = NO_PUBLICATION

    @property
    def language(self) -> str:
        """In which tables speak."""
        return self.study.languages[0] if self.study.languages else "en"

    def say(self, text: Mapping[str, str]) -> str:
        """Return a text in the language of the tables."""
        return spoken(text, self.language)

    @property
    def registration(self) -> str:
        """The questionnaire about the person; empty when the study has none."""
        about_person = (step for step in self.study.asking if step.is_about_person)
        return next((step.questionnaire for step in about_person), "")

    def sessions_of(self, participants: Iterable[str]) -> tuple[str, ...]:
        """Return the ids of the sessions of participants."""
        wanted = set(participants)
        rows = (*self.sessions, *self.others)
        return tuple(one.id for one in rows if one.participant in wanted)

    def robot(self, name: str) -> RobotRecord:
        """Return a robot; one that the dataset does not describe is called by its name."""
        return next(
            (one for one in self.robots if one.name == name),
            RobotRecord(name=name, title=name, series=name),
        )

    def course(self, session: SessionRecord) -> Course | None:
        """Return what was to be driven in a session."""
        series = self.robot(session.robot).series
        return next(
            (one for one in self.study.courses if (one.robot, one.site) == (series, session.site)),
            None,
        )

    def questionnaire(self, name: str) -> Definition | None:
        """Return the newest version of a questionnaire."""
        return max(
            (one for one in self.questionnaires if one.slug == name),
            key=lambda one: one.version,
            default=None,
        )

    @property
    def included(self) -> tuple[ParticipantRecord, ...]:
        """The participants who neither withdrew nor are excluded by a rule of the plan."""
        excluded = excluded_participants(self.exclusions) if not self.is_with_excluded else ()
        return tuple(
            one for one in self.participants if not one.withdrawn and one.id not in excluded
        )

    def counting(
        self, kinds: Sequence[Kind] = ("participant",), *, with_excluded: bool = False
    ) -> "Dataset":
        """Return the part of a whole dataset that counts: participants of some kinds with the
        drives that count, the answers about these, and all pages and events of their task.

        Args:
            kinds: who is chosen.
            with_excluded: whether what is excluded counts as well: a sensitivity analysis.
        """
        return counting.counting_part(self, kinds, with_excluded=with_excluded)
