"""A study as it is written: version 1 of the JSON format, one class a kind of thing.

A study is the *steps* that a participant goes through, the *conditions* that are compared, and the
*courses* that are driven. What happens in which order for whom follows from it alone
(experiments/participation/assignment.py, experiments/tasks/engine.py); a published study is frozen
by the SHA-256 of its definition. What is stored, exported and hashed names every value, so that a
release that changes a default changes no study. Metres, radians, m/s and seconds in the frame of
the site's map, unless a name says minutes.

Texts are objects of languages, as in questionnaires. The classes refuse unknown fields and wrong
types; experiments/definition/problems.py tells what types cannot,
experiments/definition/feasibility.py what only the sites, robots and questionnaires at hand can.

The steps that a participant goes through are a file a kind in experiments/definition/steps/.
"""

from hashlib import sha256
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
from robots.api.floorplan import Key as PlanKey
from robots.api.floorplan import Length
from robots.api.messages import AssistLevel, Metres, Point, Positive, Share
from robots.api.prepared import prepare
from surveys.documents import DocumentPart, Key, Language, Slug, Text, fields_of

if TYPE_CHECKING:
    AnyStep = Step
else:
    AnyStep = Union[tuple(KINDS.values())]  # noqa: UP007 - the kinds are found when this is read

Outcome = Literal[
    "completed",
    "timed_out",
    "connection_refused",
    "cancelled",
    "stopped_by_operator",
    "robot_fault",
    "connection_lost",
]


# --- where it is driven ---------------------------------------------------------------------------


class StudyCheckpoint(DocumentPart, frozen=True, kw_only=True):
    """A point of the course, passed within `radius` and in the same room. Number 0 is the charging
    station: it is left, and returned to.
    """

    number: Annotated[int, Meta(ge=0, le=99)]
    x: Metres
    y: Metres
    radius: Length = 0.6
    title: Text = {}


class PhotoTask(DocumentPart, frozen=True, kw_only=True):
    """The photo of one's own reflection, asked for within `radius` of a checkpoint that was passed.

    `view` is how far the mirror may lie off the camera's axis for the visitor to see the robot in
    it.
    """

    checkpoint: Annotated[int, Meta(ge=1, le=99)]
    mirror: PlanKey
    radius: Length = 1.5
    view: Annotated[float, Meta(gt=0.0, lt=1.5)] = 0.6


class Zone(DocumentPart, frozen=True, kw_only=True):
    """A part of the floor for which times and collisions are told apart; `polygon` in order, not
    closed.
    """

    name: Key
    title: Text
    polygon: Annotated[tuple[Point, ...], Meta(min_length=3, max_length=100)]


class Course(DocumentPart, frozen=True, kw_only=True):
    """What one series of robots drives at one site. `doors` have to be crossed, each only where the
    condition leaves it open.
    """

    robot: PlanKey
    site: PlanKey
    dock: Annotated[str, Meta(pattern=r"^([a-z0-9][a-z0-9_-]{0,63})?$")] = ""
    checkpoints: Annotated[tuple[StudyCheckpoint, ...], Meta(max_length=100)]
    path: Annotated[tuple[Point, ...], Meta(max_length=500)] = ()
    doors: tuple[PlanKey, ...] = ()
    zones: Annotated[tuple[Zone, ...], Meta(max_length=100)] = ()
    photo: PhotoTask | None = None


# --- what is compared -----------------------------------------------------------------------------


class Impairment(DocumentPart, frozen=True, kw_only=True):
    """What is put on one direction of the network: seconds, shares, and bit/s. The seed comes from
    the session.
    """

    delay: Delay = 0.0
    jitter: Delay = 0.0
    loss: Share = 0.0
    reorder: Share = 0.0
    bitrate: Annotated[float, Meta(ge=1_000.0, le=1e9)] | None = None


class Network(DocumentPart, frozen=True, kw_only=True):
    """The network of a condition, towards the robot and back from its camera."""

    control: Impairment | None = None
    video: Impairment | None = None


class SpeedChoice(DocumentPart, frozen=True, kw_only=True):
    """A speed limit below the robot's own."""

    linear: Positive | None = None
    angular: Positive | None = None


class Condition(DocumentPart, frozen=True, kw_only=True):
    """One way to do the task. What it says, the visitor cannot change.

    `levels` is its cell: its level of each factor. `robot` is a series. `access` says who may be
    assigned to it: everybody who has the link, or those who were invited. `idle_seconds` is how
    long a driver may do nothing before being asked
    whether anybody is there; absent or 0 for ever, for a drive of a study has its own time limit.
    """

    key: Key
    title: Text
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


# --- the rules ------------------------------------------------------------------------------------


class BalanceFactor(DocumentPart, frozen=True, kw_only=True):
    """A property of participants that is to be distributed evenly over the cells.

    `item` is `age`, as given with the consent, or `questionnaire.item`, as answered before the
    robot is assigned. Numbers are grouped: below the first of `limits`, then from each of them on.
    Participants without an answer form a group of their own.
    """

    item: Annotated[str, Meta(pattern=r"^(age|[a-z][a-z0-9-]{0,39}\.[a-z][a-z0-9_]{0,39})$")]
    limits: Annotated[tuple[float, ...], Meta(max_length=10)] = ()


class Allocation(DocumentPart, frozen=True, kw_only=True):
    """Who gets which condition.

    Between participants each does one condition; within them each does all that are open to them,
    in an order: `fixed` as written, `all` orders, or `balanced` ones. With factors of both kinds a
    participant does the conditions of one cell of the between factors. `quota` is how many
    participants fill a cell (a condition, or an order); None is no end. Participants who have
    several conditions to do and are not seen for `left_after_hours` before the last of them have
    left: another participant gets the order.

    A participant gets the cell with the fewest participants with probability `best_probability`,
    else any other one: with 1, whoever knows the numbers knows each assignment beforehand. With
    `balance`, the participants that are counted are those alike in all of these factors (`strata`),
    or in each of them, added up (`minimization`).
    """

    design: Design = "between"
    order: Literal["fixed", "all", "balanced"] = "balanced"
    quota: Annotated[int, Meta(ge=1, le=100_000)] | None = None
    left_after_hours: Annotated[float, Meta(ge=1.0, le=8760.0)] = 24.0
    best_probability: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.75
    balancing: Literal["strata", "minimization"] = "minimization"
    balance: Annotated[tuple[BalanceFactor, ...], Meta(max_length=6)] = ()


class Refill(DocumentPart, frozen=True, kw_only=True):
    """Exposed participants with one of these outcomes leave their place to another, at most `most`
    times a cell; they stay in its flow.
    """

    outcomes: tuple[Outcome, ...] = ()
    most: Annotated[int, Meta(ge=0, le=10_000)] = 0


class Quality(DocumentPart, frozen=True, kw_only=True):
    """What a session's record must be like to be called good; rates in Hz, times in s."""

    least_sample_rate: Annotated[float, Meta(ge=0.0, le=50.0)] = 3.5
    longest_gap: Positive = 2.0
    largest_clock_offset: Positive = 0.25
    condition_applied: bool = True
    operator_absent: bool = True


class Start(DocumentPart, frozen=True, kw_only=True):
    """What must hold before a participant gets the robot; else they wait, and researchers are told.

    `docked`: it is docked, at most `distance` metres and `heading` radians off the pose of the
    course's station, and knows where it is. `charge` is the least share of the battery's charge; a
    robot that does not know its charge is taken as it is.
    """

    docked: bool = True
    distance: Length = 0.3
    heading: Annotated[float, Meta(gt=0.0, le=3.2)] = 0.35
    charge: Share = 0.0


class Analysis(DocumentPart, frozen=True, kw_only=True):
    """What counts in results, and of which kind the intervals of confidence are.

    `drives` is which of several drives of one participant in one condition count; of `all`, values
    are averaged first. `counts` is which of several responses of one participant counts, among
    those about drives that count.
    """

    drives: Literal["first", "last", "all"] = "all"
    counts: Literal["first", "last", "all"] = "first"
    interval: Literal["normal", "t"] = "t"
    statements: Slug = "experience"


class StudyDefinition(DocumentPart, frozen=True, kw_only=True):
    """A whole study. `recruitment` says how participants are found, `compensation` what they get;
    researchers write and read both. With `turned_away_code`, people who are turned away get a code
    of their own for the recruitment site. Only people with one of the `devices` and `browsers`
    (none means any) can begin. `screening` and `answer_quotas` turn away by answers. A
    participant's drive is private unless `observers_allowed`: then whoever may watch the robot may
    watch it, too.
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
        return next((condition for condition in self.conditions if condition.key == key), None)

    def course_of(self, condition: Condition) -> Course | None:
        return next(
            (
                course
                for course in self.courses
                if (course.robot, course.site) == (condition.robot, condition.site)
            ),
            None,
        )

    @property
    def task(self) -> TaskStep | None:
        return next((step for step in self.steps if isinstance(step, TaskStep)), None)

    @property
    def consent(self) -> Consent | None:
        return next((step for step in self.steps if isinstance(step, Consent)), None)

    @property
    def tells_condition(self) -> bool:
        """Whether participants read something that only their condition says."""
        return any(step.named_conditions for step in self.steps)

    @property
    def reveals_condition(self) -> bool:
        """Whether participants learn something of their condition before any video: from
        instructions, or because the drive page shows it as soon as the robot is theirs.
        """
        looks = {
            (one.access, one.robot, one.site): (one.interface, one.controllers, one.actions)
            for one in reversed(self.conditions)
        }
        return self.tells_condition or any(
            looks[one.access, one.robot, one.site] != (one.interface, one.controllers, one.actions)
            for one in self.conditions
        )

    @property
    def tells_of_operator(self) -> bool:
        """Whether its debriefing tells of the hidden operator, in every language."""
        return all(self.operator_text.get(name, "").strip() for name in self.languages)

    @property
    def operator_text(self) -> Text:
        """What its debriefing tells of the hidden operator; empty in a study without one."""
        told = [step.operator for step in self.steps if isinstance(step, Debrief)]
        return told[-1] if told and self.wizard is not None else {}

    def wizard_of(self, condition: str) -> Wizard | None:
        """Return the hidden operator's part in a condition; None where the participant drives."""
        wizard = self.wizard
        return wizard if wizard is not None and wizard.drives_in(condition) else None

    @property
    def drives(self) -> tuple[DriveStep, ...]:
        return tuple(step for step in self.steps if isinstance(step, DriveStep))

    @property
    def practice_keys(self) -> frozenset[str]:
        return frozenset(step.key for step in self.drives if step.is_practice)

    @property
    def asking(self) -> tuple[AskingStep, ...]:
        return tuple(step for step in self.steps if isinstance(step, AskingStep))

    def step(self, key: str) -> AnyStep | None:
        return next((step for step in self.steps if step.key == key), None)

    def drive(self, key: str) -> DriveStep | None:
        return next((step for step in self.drives if step.key == key), None)


prepare(StudyDefinition)


def as_stored(value: Any) -> Any:
    """Return a part of a study as JSON has it, with every value, also those of defaults."""
    if isinstance(value, tuple):
        return [as_stored(one) for one in value]
    if not isinstance(value, msgspec.Struct):
        return value
    config = value.__struct_config__
    tag = {config.tag_field: config.tag} if config.tag_field else {}
    return tag | {
        field.encode_name: as_stored(getattr(value, field.name)) for field in fields_of(type(value))
    }


def to_json(study: StudyDefinition) -> bytes:
    """Return a study as the JSON that import takes: with every value, indented, fields in the order
    of the classes.
    """
    return msgspec.json.format(msgspec.json.encode(as_stored(study)), indent=2) + b"\n"


def digest(study: StudyDefinition) -> str:
    """Return the SHA-256 of a study's JSON with every value, sorted keys and no white space. It
    freezes a published version.
    """
    return sha256(msgspec.json.encode(as_stored(study), order="deterministic")).hexdigest()


def from_stored(document: Any) -> StudyDefinition:
    """Return the study that a database row holds; it was checked when it was stored."""
    return msgspec.convert(document, StudyDefinition)
