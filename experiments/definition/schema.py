"""The definition of a study: version 1 of the JSON format, one class for each kind of part.

A published definition is frozen by its SHA-256. Stored, exported and hashed definitions contain
every value, so that changed defaults of a release change no study. Texts are objects by language.
Units are metres, radians, m/s and s in the frame of the site's map, unless a name says minutes.
The classes check types, problems.py the rest, feasibility.py what depends on a server.
docs/reference/studies.md explains every field.
"""

from collections import Counter
from hashlib import sha256
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import msgspec
from msgspec import Meta

from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.coding import CodingScheme
from experiments.definition.design import (
    Controller,
    ControlWay,
    Delay,
    Design,
    Factor,
    Levels,
    OwnAction,
    TitledPart,
)
from experiments.definition.plan import StudyPlan
from experiments.definition.recruitment.recruiting import (
    AnswerQuota,
    AnswerRule,
    Appointments,
    Browser,
    DeviceKind,
    Recruiting,
)
from experiments.definition.step import AskingStep, DriveStep, Step, Version
from experiments.definition.steps import KINDS
from experiments.definition.steps.consent import Consent
from experiments.definition.steps.debrief import Debrief
from experiments.definition.steps.task import TaskStep
from experiments.definition.wizard import Wizard
from robots.api.floorplan import Key as PlanKey, Length
from robots.api.messages import AssistLevel, Metres, Point, Positive, Share
from robots.api.prepared import prepare
from surveys.documents import DocumentPart, Key, Language, Slug, Text, fields_of

if TYPE_CHECKING:
    AnyStep = Step
else:
    AnyStep = Union[tuple(KINDS.values())]  # noqa: UP007 - found at run time

Outcome = Literal[
    "completed",
    "timed_out",
    "connection_refused",
    "cancelled",
    "stopped_by_operator",
    "robot_fault",
    "connection_lost",
]


class StudyCheckpoint(DocumentPart, frozen=True, kw_only=True):
    """A point, passed within `radius` metres in the same room. Number 0 is the charging station."""

    number: Annotated[int, Meta(ge=0, le=99)]
    x: Metres
    y: Metres
    radius: Length = 0.6
    title: Text = {}


class PhotoTask(DocumentPart, frozen=True, kw_only=True):
    """A photo of the robot's reflection, due within `radius` metres of a passed checkpoint. The
    robot is in the picture while the mirror is within `view` radians of the camera's axis.
    """

    checkpoint: Annotated[int, Meta(ge=1, le=99)]
    mirror: PlanKey
    radius: Length = 1.5
    view: Annotated[float, Meta(gt=0.0, lt=1.5)] = 0.6


class Zone(DocumentPart, frozen=True, kw_only=True):
    """A part of the floor with its own times and collisions; `polygon` in order, not closed."""

    name: Key
    title: Text
    polygon: Annotated[tuple[Point, ...], Meta(min_length=3, max_length=100)]


class Course(DocumentPart, frozen=True, kw_only=True):
    """The course of a series of robots at a site. `doors` must be crossed where they are open."""

    robot: PlanKey
    site: PlanKey
    dock: Annotated[str, Meta(pattern=r"^([a-z0-9][a-z0-9_-]{0,63})?$")] = ""
    checkpoints: Annotated[tuple[StudyCheckpoint, ...], Meta(max_length=100)]
    path: Annotated[tuple[Point, ...], Meta(max_length=500)] = ()
    doors: tuple[PlanKey, ...] = ()
    zones: Annotated[tuple[Zone, ...], Meta(max_length=100)] = ()
    photo: PhotoTask | None = None


class Impairment(DocumentPart, frozen=True, kw_only=True):
    """Impairments of one direction of the network: seconds, shares, and bit/s."""

    delay: Delay = 0.0
    jitter: Delay = 0.0
    loss: Share = 0.0
    reorder: Share = 0.0
    bitrate: Annotated[float, Meta(ge=1_000.0, le=1e9)] | None = None


class Network(DocumentPart, frozen=True, kw_only=True):
    """Impairments towards the robot (`control`) and from its camera."""

    control: Impairment | None = None
    video: Impairment | None = None


class SpeedChoice(DocumentPart, frozen=True, kw_only=True):
    """A speed limit below the robot's own."""

    linear: Positive | None = None
    angular: Positive | None = None


class Condition(TitledPart, frozen=True, kw_only=True):
    """The robot, settings and limits with which a participant drives. `levels` are its cell: its
    level of each factor. `robot` is a series. After `idle_seconds` without input the page asks
    whether the driver is there; None or 0: never.
    """

    levels: Levels = {}
    robot: PlanKey
    site: PlanKey
    access: Literal["open", "invitation"] = "open"
    control_way: ControlWay = "any"
    controllers: tuple[Controller, ...]
    actions: tuple[OwnAction, ...] = ()
    assist: AssistLevel = "off"
    interface: Key = "standard"
    speed: SpeedChoice = SpeedChoice()
    doors_closed: tuple[PlanKey, ...] = ()
    network: Network = Network()
    idle_seconds: Annotated[float, Meta(ge=0.0, le=3600.0)] | None = None


class BalanceFactor(DocumentPart, frozen=True, kw_only=True):
    """A property of participants that assignment distributes evenly over the cells: `age`, or a
    `questionnaire.item` that is answered before. Numbers are grouped: below the first of `limits`,
    then from each of them on. Participants without an answer are a group of their own.
    """

    item: Annotated[str, Meta(pattern=r"^(age|[a-z][a-z0-9-]{0,39}\.[a-z][a-z0-9_]{0,39})$")]
    limits: Annotated[tuple[float, ...], Meta(max_length=10)] = ()


class Allocation(DocumentPart, frozen=True, kw_only=True):
    """The assignment of conditions. Within participants, each does all conditions with their access
    (in a mixed design, all of one cell of the between factors) in an order; a cell is then an
    order, else a condition. `quota` is the number of participants per cell; None: no limit. A
    participant with conditions left who is not seen for `left_after_hours` dropped out: another
    participant gets the order.

    A participant gets the cell with the fewest participants with `best_probability`, else any other
    one. With `balance`, only alike participants are counted: alike in all factors (`strata`), or in
    each factor, added up (`minimization`).
    """

    design: Design = "between"
    order: Literal["fixed", "all", "balanced"] = "balanced"
    quota: Annotated[int, Meta(ge=1, le=100_000)] | None = None
    left_after_hours: Annotated[float, Meta(ge=1.0, le=8760.0)] = 24.0
    best_probability: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.75
    balancing: Literal["strata", "minimization"] = "minimization"
    balance: Annotated[tuple[BalanceFactor, ...], Meta(max_length=6)] = ()


class Refill(DocumentPart, frozen=True, kw_only=True):
    """Exposed participants with one of these outcomes are replaced, `most` per cell at most."""

    outcomes: tuple[Outcome, ...] = ()
    most: Annotated[int, Meta(ge=0, le=10_000)] = 0


class Quality(DocumentPart, frozen=True, kw_only=True):
    """The requirements of a good record of a session; rates in Hz, times in s."""

    least_sample_rate: Annotated[float, Meta(ge=0.0, le=50.0)] = 3.5
    longest_gap: Positive = 2.0
    largest_clock_offset: Positive = 0.25
    condition_applied: bool = True
    operator_absent: bool = True


class Start(DocumentPart, frozen=True, kw_only=True):
    """The requirements on the robot before a participant gets it; else the participant waits and
    the researchers are notified. `docked`: in the course's station, localized, and at most
    `distance` metres and `heading` radians off its pose. `charge` is the minimum share of the
    battery; a robot that does not report its charge passes.
    """

    docked: bool = True
    distance: Length = 0.3
    heading: Annotated[float, Meta(gt=0.0, le=3.2)] = 0.35
    charge: Share = 0.0


class Analysis(DocumentPart, frozen=True, kw_only=True):
    """The data that counts in results. `drives`: which drives of one participant in one condition;
    `all` are averaged. `counts`: which response of one participant, among those about drives that
    count. `statements` is the questionnaire of the tables of statements; of several steps that ask
    it, they show the last.
    """

    drives: Literal["first", "last", "all"] = "all"
    counts: Literal["first", "last", "all"] = "first"
    interval: Literal["normal", "t"] = "t"
    statements: Slug = "experience"


class StudyDefinition(DocumentPart, frozen=True, kw_only=True):
    """A whole study. Participants read neither `recruitment` nor `compensation`. With
    `turned_away_code`, people who are turned away get a separate completion code. A drive is
    private unless `observers_allowed`. `devices` and `browsers`: empty for any.
    """

    format: Literal[1]
    slug: Slug
    version: Version
    title: Text
    intro: Text = {}
    source: str = ""
    licence: str = ""
    recruitment: str = ""
    compensation: str = ""
    turned_away_code: bool = False
    observers_allowed: bool = False
    languages: tuple[Language, ...]
    steps: Annotated[tuple[AnyStep, ...], Meta(max_length=60)]
    factors: Annotated[tuple[Factor, ...], Meta(max_length=4)] = ()
    conditions: Annotated[tuple[Condition, ...], Meta(max_length=24)]
    courses: Annotated[tuple[Course, ...], Meta(max_length=24)]
    allocation: Allocation = Allocation()
    refill: Refill = Refill()
    start: Start = Start()
    quality: Quality = Quality()
    analysis: Analysis = Analysis()
    analyses: Annotated[tuple[DeclaredAnalysis, ...], Meta(max_length=40)] = ()
    wizard: Wizard | None = None
    plan: StudyPlan | None = None
    coding: CodingScheme | None = None
    recruiting: Recruiting | None = None
    devices: tuple[DeviceKind, ...] = ()
    browsers: tuple[Browser, ...] = ()
    screening: Annotated[tuple[AnswerRule, ...], Meta(max_length=40)] = ()
    answer_quotas: Annotated[tuple[AnswerQuota, ...], Meta(max_length=40)] = ()
    appointments: Appointments | None = None

    def condition(self, key: str) -> Condition | None:
        return next((one for one in self.conditions if one.key == key), None)

    def course_of(self, condition: Condition) -> Course | None:
        place = (condition.robot, condition.site)
        return next((one for one in self.courses if (one.robot, one.site) == place), None)

    @property
    def task(self) -> TaskStep | None:
        return next((step for step in self.steps if isinstance(step, TaskStep)), None)

    @property
    def consent(self) -> Consent | None:
        return next((step for step in self.steps if isinstance(step, Consent)), None)

    @property
    def has_condition_specific_pages(self) -> bool:
        """Whether participants read something that depends on their condition."""
        return any(step.named_conditions for step in self.steps)

    @property
    def reveals_condition(self) -> bool:
        """Whether instructions, robot or drive page show something of it before any video."""
        return self.has_condition_specific_pages or self._differs("interface controllers actions")

    @property
    def decides_robot(self) -> bool:
        """Whether the robot depends on the condition, of those with the same access."""
        return self._differs("")

    def _differs(self, names: str) -> bool:
        """Tell whether conditions with the same access differ in the robot, or in these fields."""
        parts = attrgetter("access", "robot", "site", *names.split())
        accesses = {one.access for one in self.conditions}
        return len(set(map(parts, self.conditions))) > len(accesses)

    @property
    def tells_of_operator(self) -> bool:
        return all(self.operator_text.get(name, "").strip() for name in self.languages)

    @property
    def operator_text(self) -> Text:
        """The debriefing's text about the hidden operator; empty without an operator."""
        texts = [step.operator for step in self.steps if isinstance(step, Debrief)]
        return texts[-1] if texts and self.wizard is not None else {}

    def wizard_of(self, condition: str) -> Wizard | None:
        """Return the hidden operator in a condition; None where the participant drives."""
        wizard = self.wizard
        return wizard if wizard is not None and wizard.drives_in(condition) else None

    @property
    def drives(self) -> tuple[DriveStep, ...]:
        return tuple(step for step in self.steps if isinstance(step, DriveStep))

    @property
    def practice_keys(self) -> frozenset[str]:
        return frozenset(step.key for step in self.drives if step.is_practice)

    @property
    def questionnaire_steps(self) -> tuple[AskingStep, ...]:
        return tuple(step for step in self.steps if isinstance(step, AskingStep))

    @property
    def screening_steps(self) -> dict[str, AskingStep]:
        """The step of each questionnaire whose answers may screen out: the first one that asks it,
        if that is before the task.
        """
        last = len(self.steps) if self.task is None else self.steps.index(self.task)
        before = (one for one in self.steps[:last] if isinstance(one, AskingStep))
        return {one.questionnaire: one for one in reversed([*before])}

    @property
    def asked(self) -> dict[str, AskingStep]:
        """The questionnaires as variables of results: each is named after its questionnaire, and
        after questionnaire and step (`trust.before`) where several steps ask it.
        """
        steps = self.questionnaire_steps
        times = Counter(step.questionnaire for step in steps)
        names = (
            one.questionnaire + f".{one.key}" * (times[one.questionnaire] > 1) for one in steps
        )
        return dict(zip(names, steps, strict=True))

    def when(self, step: Step) -> str:
        """Return on which side of the task a step is, in words."""
        keys, task = [one.key for one in self.steps], self.task
        if task is None or step == task:
            return "during the task"
        is_first = keys.index(step.key) < keys.index(task.key)
        return "before the task" if is_first else "after the task"

    @property
    def statements(self) -> str:
        """The variable of the tables of statements: of several steps, the last."""
        name = self.analysis.statements
        own = [key for key, step in self.asked.items() if step.questionnaire == name]
        return own[-1] if own else name

    def step(self, key: str) -> AnyStep | None:
        return next((step for step in self.steps if step.key == key), None)

    def drive(self, key: str) -> DriveStep | None:
        return next((step for step in self.drives if step.key == key), None)


prepare(StudyDefinition)


def as_stored(value: Any) -> Any:
    """Return a part of a study as JSON has it, including the values of defaults."""
    if isinstance(value, tuple):
        return [as_stored(one) for one in value]
    if not isinstance(value, msgspec.Struct):
        return value
    config = value.__struct_config__
    tag = {config.tag_field: config.tag} if config.tag_field else {}
    fields = fields_of(type(value))
    return tag | {one.encode_name: as_stored(getattr(value, one.name)) for one in fields}


def to_json(study: StudyDefinition) -> bytes:
    """Return a study as indented JSON with every value, in the order of the classes."""
    return msgspec.json.format(msgspec.json.encode(as_stored(study)), indent=2) + b"\n"


def digest(study: StudyDefinition) -> str:
    """Return the SHA-256 of a study's JSON with every value, sorted keys and no white space."""
    return sha256(msgspec.json.encode(as_stored(study), order="deterministic")).hexdigest()


def from_stored(document: Any) -> StudyDefinition:
    return msgspec.convert(document, StudyDefinition)
