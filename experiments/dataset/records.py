"""A study's records as plain data: all that tables and figures are made of, wherever it was read
from. A field that is a column of a file declares it.

States and network samples are numbers in columns (states.py), read a session at a time, because
those of a thousand sessions do not fit beside each other.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import msgspec

from experiments.dataset import levels
from experiments.dataset.columns import NO_YES, REQUIRED, Columns, column, described, measure, word
from experiments.dataset.levels import PLATFORM, Kind
from experiments.dataset.states import NO_NETWORK, NO_STATES
from experiments.definition.publication import PublicationDetails
from experiments.definition.schema import Course, StudyDefinition
from experiments.definition.step import AskingStep
from robots.api.floorplan import FloorPlan
from surveys.definition import Definition
from surveys.documents import spoken

COMPLETED = "completed"
# The drives that count, and a sensitivity analysis: those and the excluded ones. Both are the names
# of folders in a report.
COUNTING, EVERY = "counting", "all"
Counts = Annotated[bool, described("1 when it counts in the results on participants", late=True)]
IN_FIRST = "in the first state; empty when unknown"
IN_LAST = "in the last state; empty when unknown"


class RobotRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A robot: `series` is what courses are made for, `facts` are the rows of Table 1 by name."""

    name: str
    title: str
    series: str
    facts: dict[str, str] = {}


class FreezeRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """When the definition of a study was frozen, and what its site knew then.

    `sha256` is that of the definition; `frozen_at` is in UTC, to the minute, and empty for a draft.
    `before_data` tells whether the first participant of this version started later (None for a
    draft); the time is left out, because it would be a date of a person. `earlier` counts the
    participants of earlier versions before that. `deviations` is what researchers wrote about
    deviations from the plan, `software` the version of the server's software that wrote this.
    """

    sha256: str
    frozen_at: str = ""
    before_data: bool | None = None
    earlier: int = 0
    deviations: str = ""
    software: str = ""


@dataclass(frozen=True)
class ParticipantRecord:
    """A row of the participants; an age that was not given is NaN."""

    id: str = column(REQUIRED, "code of the participant")
    kind: Kind = column("participant", "who took part", levels=levels.KINDS)
    age: float = measure(
        "self-reported age (consent page); empty in a public dataset", "years", least=0.0
    )
    age_band: str = word("that, as a range", levels.AGE_BANDS, late=True)
    cell: str = word("assigned condition, or conditions in order", divider="-")
    first_cell: str = word(
        "cell that was drawn first; another than `cell` where the participant saw nothing of it and"
        " was drawn again",
        late=True,
        divider="-",
    )
    draws: int = column(0, "how often a cell was drawn", late=True, least=0.0)
    stage: str = word("last stage of the study that was reached", levels.STAGES, late=True)
    place: str = word(
        "what became of the place in the cell; empty without one", levels.PLACES, late=True
    )
    reached: str = word("last step of the study that was begun")
    left: str = word(
        "why the participant left there; empty if they finished or are still taking part",
        levels.LEFT,
    )
    finished: bool = column(False, "1 when the last step was finished")
    withdrawn: bool = column(False, "1 when the participant withdrew: step and day remain")


@dataclass(frozen=True)
class SessionRecord:
    """A row of the sessions; the time of what did not happen is NaN. `counts_why` is set by
    counting.py; in datasets of earlier releases `visit` is 0.
    """

    id: str = column(REQUIRED, "code of the session")
    participant: str = column(REQUIRED, "code of its participant")
    robot: str = column(REQUIRED, "name of the robot")
    kind: Kind = column("participant", "who took part", levels=levels.KINDS)
    number: int = column(
        1,
        "first, second … drive of the participant in this condition, of those in which the robot"
        " was driven and that the platform did not end; 0 for all others",
        least=0.0,
    )
    visit: int = column(
        0, "first, second … visit of the participant to the study", late=True, least=0.0
    )
    round: int = column(
        0, "first, second … condition of the participant in this visit", late=True, least=0.0
    )
    practice: bool = column(False, "1 for practice, which counts nowhere")
    counts_why: str = word("why it does not count; empty when it does", levels.UNCOUNTED, late=True)
    site: str = word("name of the floor plan")
    condition: str = word("assigned condition")
    mismatch: str = word(
        "what was not applied as assigned; empty when everything was",
        levels.MISMATCHES,
        divider="|",
    )
    control_way: str = word("assigned control channel of the commands", levels.CONTROL_WAYS)
    assist: str = word("assigned assistance", levels.ASSISTANCE)
    doors_closed: tuple[str, ...] = column(
        (), "doors that were closed; empty when none was", divider="|"
    )
    control_network: str = word(
        "assigned impairment of the network towards the robot: delay and jitter in ms, loss and"
        " reorder in %, rate in kbit/s"
    )
    video_network: str = word("assigned impairment of the network back from its camera, likewise")
    control_applied: str = word("the impairment towards the robot that it last reported as applied")
    video_applied: str = word("the impairment back from its camera, likewise")
    outcome: str = word("how the session ended", levels.OUTCOMES)
    reason: str = word(
        "why; with free text also what an operator wrote; empty: the outcome says it",
        levels.END_REASONS,
    )
    os: str = word(
        "operating system of the visitor's device; empty when unknown or withheld",
        levels.SYSTEM_NAMES,
    )
    browser: str = word(
        "browser of the visitor's device; empty when unknown or withheld", levels.BROWSER_NAMES
    )
    network: str = word("hash of the visitor's network, for counting them")
    first_frame: float = measure(
        "when the server heard from the page that it showed the first video frame, since the"
        " grant, by the server's clock; exposure and the task's time begin here; empty when the"
        " page never showed one",
        "s",
    )
    first_motion: float = measure(
        "when the server first had a state in which the robot moved for the participant, since"
        " the grant, by the server's clock: a velocity of the driver that is not 0 was applied, or"
        " the robot drove by itself to a place, a point or its dock; leaving the dock by itself"
        " does not count; empty when the robot never moved so",
        "s",
    )
    ended: float = measure(
        "when the session ended, since the grant, by the server's clock; a lost connection or"
        " silent robot ends it when it was lost, not when waiting for it was over",
        "s",
    )
    began_x: float = measure(f"position {IN_FIRST}", "m", late=True)
    began_y: float = measure(f"position {IN_FIRST}", "m", late=True)
    began_theta: float = measure(f"heading on the map {IN_FIRST}", "rad", late=True)
    began_docked: float = measure(
        "1 when docked in the first state; empty when there is none", late=True, levels=NO_YES
    )
    began_charge: float = measure(f"share of the battery's charge {IN_FIRST}", late=True)
    ended_x: float = measure(f"position {IN_LAST}", "m", late=True)
    ended_y: float = measure(f"position {IN_LAST}", "m", late=True)
    ended_theta: float = measure(f"heading on the map {IN_LAST}", "rad", late=True)
    ended_docked: float = measure(
        "1 when docked in the last state; empty when there is none", late=True, levels=NO_YES
    )
    ended_charge: float = measure(f"share of the battery's charge {IN_LAST}", late=True)
    docked_seconds: float = measure(
        "how long the robot had to rest on its charging contacts to be docked; empty where one"
        " state in the station was enough",
        "s",
        late=True,
        least=0.0,
    )
    dock_contacts: float = measure(
        "how often the charging contacts met after the last checkpoint; 1 is a docking that"
        " held at once; empty without that rule",
        late=True,
        least=0.0,
    )
    operator: bool = column(False, "1 when an operator intervened")
    missing: int = column(0, "states that are known to be lost", least=0.0)
    excluded: str = word("why a researcher excluded it; empty when not")
    excluded_at: str = word(
        "when a researcher excluded it, in UTC; in public datasets only the day", late=True
    )
    fault_side: str = word("whose fault the end was; empty when nobody's", levels.SIDES, late=True)
    fault_part: str = word(
        "part of the platform that was unavailable then", levels.PARTS, late=True
    )
    server_version: str = word(levels.VERSIONED["server"], late=True)
    agent_version: str = word(levels.VERSIONED["agent"], late=True)
    adapter_version: str = word(levels.VERSIONED["adapter"], late=True)
    driver_version: str = word(levels.VERSIONED["driver"], late=True)
    metrics_version: str = word(levels.VERSIONED["metrics"], late=True)
    definition_version: str = word(levels.VERSIONED["definition"], late=True)

    @property
    def counts(self) -> Counts:
        return not self.counts_why

    @property
    def uncounted_because(self) -> str:
        """Why it does not count, in words; empty when it counts."""
        own = {levels.PLATFORM_FAULT: self.fault, levels.EXCLUDED: self.excluded}
        return own.get(self.counts_why) or levels.UNCOUNTED.get(self.counts_why, "")

    @property
    def fault(self) -> str:
        """The platform's fault that ended it; empty when none did."""
        if self.fault_side != PLATFORM:
            return ""
        part = self.fault_part.replace("_", " ")
        return f"platform fault: {part} away" if part else "platform fault"

    @property
    def drove(self) -> bool:
        """Whether the robot ever moved for its visitor (sessions/visitor_motion.py)."""
        return not math.isnan(self.first_motion)

    @property
    def exposed(self) -> bool:
        """Whether the page showed a video frame of the task; who drove has seen one."""
        return self.drove or not math.isnan(self.first_frame)


@dataclass(frozen=True)
class EventRecord:
    session: str = column(REQUIRED, "code of the session")
    stamp: float = column(
        REQUIRED,
        "when it happened, since the grant, by the server's clock: of robot and page by their"
        " own, corrected by its median difference to the server's (when the server heard of it,"
        " where that is a day or more); of the task when the state that it follows from was"
        " taken, or when the server heard from the page",
        "s",
    )
    source: str = column(REQUIRED, "what reported it", levels=levels.SOURCES)
    type: str = column(REQUIRED, "what happened")
    data: Mapping[str, Any] = column(
        {}, "JSON: the rest; the levels of `type` name the fields of each"
    )


@dataclass(frozen=True)
class PageRecord:
    participant: str = column(REQUIRED, "who saw the page")
    step: str = column(REQUIRED, "step of the study")
    session: str = word("session that it belongs to, if any")
    seconds: float = measure(
        "from its first display until the participant continued, by the server's clock; empty"
        " when it was not finished",
        "s",
        least=0.0,
    )
    finished: bool = column(True, "1 when the participant continued from it")


@dataclass(frozen=True)
class AnswerRecord:
    """A row of the answers: an item of a response, or a response without items."""

    response: str = column(REQUIRED, "code of the filled-in questionnaire")
    questionnaire: str = column(REQUIRED, "its name")
    version: int = column(REQUIRED, "its version", least=0.0)
    participant: str = column(REQUIRED, "who answered")
    session: str = column(REQUIRED, "session that it was asked about, if any")
    finished: bool = column(REQUIRED, "1 when it was submitted")
    step: str = word("step of the study that asked it", late=True)
    item: str = word("question")
    value: str = word("JSON: what was answered; empty when nothing was")
    missing: str = word("why there is no value", levels.MISSING)
    seconds: float = measure(
        "time spent on the question, by the page's clock; at most the time since the"
        " questionnaire was opened, by the server's",
        "s",
        least=0.0,
    )


# The tables of a dataset, by the names of their files.
TABLES: dict[str, type] = {"participants": ParticipantRecord, "sessions": SessionRecord}
TABLES |= {"events": EventRecord, "pages": PageRecord, "answers": AnswerRecord}


@dataclass(frozen=True)
class ResponseRecord:
    """A filled-in questionnaire; `missing` tells why an item has no value. Datasets of earlier
    releases have no `step`.
    """

    id: str
    questionnaire: str
    participant: str
    values: Mapping[str, Any]
    version: int = 1
    session: str = ""
    finished: bool = True
    missing: Mapping[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    step: str = ""

    def answers(self) -> Iterator[AnswerRecord]:
        """Yield its items as rows; without items, one row."""
        of_study = self.id, self.questionnaire, self.version
        about = (*of_study, self.participant, self.session, self.finished, self.step)
        for item in dict.fromkeys((*self.values, *self.missing)) or [""]:
            given = self.values.get(item)
            value = "" if given is None else json.dumps(given, ensure_ascii=False)
            why, seconds = self.missing.get(item, ""), self.seconds.get(item, math.nan)
            yield AnswerRecord(*about, item, value, why, seconds)

    @classmethod
    def of(cls, answers: Sequence[AnswerRecord]) -> "ResponseRecord":
        """Return the response whose rows these are; a value that is not JSON is a ValueError."""
        first, items = answers[0], [one for one in answers if one.item]
        values = {one.item: json.loads(one.value) for one in items if one.value}
        return cls(
            *(first.response, first.questionnaire, first.participant, values),
            *(first.version, first.session, first.finished),
            {one.item: one.missing for one in items if one.missing},
            {one.item: one.seconds for one in items if one.seconds == one.seconds},
            first.step,
        )


NO_PUBLICATION = PublicationDetails()


@dataclass(frozen=True)
class PlanExclusion:
    """A row of the exclusions: one reason to leave out a participant, or one session of theirs."""

    participant: str = column(REQUIRED, "who is excluded")
    session: str = column(
        REQUIRED, "session that is excluded; empty: the participant with all sessions"
    )
    rule: str = column(REQUIRED, "rule that excludes them", levels=levels.RULES)
    value: str = column(REQUIRED, "what was found")
    planned: bool = column(True, "1 when the plan of the study has the rule")


@dataclass(frozen=True)
class WholeStudy:
    """The study of which a public dataset is a part: how many participants it has, pilots, bots and
    those who withdrew aside; how many of each kind withdrew; and whom the plan excludes of those in
    the public dataset, as decided on everybody's data.
    """

    participants: int
    withdrew: Mapping[Kind, int]
    exclusions: tuple[PlanExclusion, ...]


@dataclass(frozen=True)
class Dataset:
    """A study and all that was recorded of it. `states` and `network` read those of a session,
    which may have none. Datasets of earlier releases have no `freeze`; public ones have `whole`.

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
    whole: WholeStudy | None = None

    @property
    def language(self) -> str:
        return self.study.languages[0] if self.study.languages else "en"

    def say(self, text: Mapping[str, str]) -> str:
        return spoken(text, self.language)

    @property
    def registration(self) -> str:
        """The variable about the person (`StudyDefinition.asked`); empty without any."""
        asked = self.study.asked.items()
        return next((name for name, step in asked if step.is_about_person), "")

    def answers_to(self, variable: str) -> list[ResponseRecord]:
        """Return the responses to a questionnaire, at its step where several steps ask it."""
        step = self.study.asked.get(variable)
        slug, point, _key = variable.partition(".")
        own = (one for one in self.responses if one.questionnaire == slug)
        return [one for one in own if not point or (step is not None and one.step == step.key)]

    def answered_pages(self, variable: str) -> list[tuple[PageRecord, ResponseRecord]]:
        """Return the finished pages of a questionnaire, each with its response, if that counts.

        A step about drives has pages with a session, except in datasets of earlier releases. A page
        without one was then seen in a round without a drive, whose answers do not count.
        """
        key = self.study.asked[variable].key
        finished = [one for one in self.pages if one.finished and one.step == key]
        has_sessions = any(one.session for one in finished)
        responses = {
            (one.participant, one.session if has_sessions else ""): one
            for one in self.answers_to(variable)
        }
        pairs = ((page, responses.get((page.participant, page.session))) for page in finished)
        return [(page, response) for page, response in pairs if response is not None]

    def asking(self, response: ResponseRecord) -> AskingStep | None:
        """Return the step that asked a response; of earlier releases, the first that may have."""
        slug = response.questionnaire
        own = [one for one in self.study.questionnaire_steps if one.questionnaire == slug]
        return next((one for one in own if one.key == response.step), next(iter(own), None))

    def sessions_of(self, participants: Iterable[str]) -> tuple[str, ...]:
        wanted = set(participants)
        rows = (*self.sessions, *self.others)
        return tuple(one.id for one in rows if one.participant in wanted)

    def robot(self, name: str) -> RobotRecord:
        """Return a robot; one that the dataset does not describe is called by its name."""
        known = {one.name: one for one in self.robots}
        return known.get(name) or RobotRecord(name=name, title=name, series=name)

    def course(self, session: SessionRecord) -> Course | None:
        """Return what was to be driven in a session."""
        place = (self.robot(session.robot).series, session.site)
        return next((one for one in self.study.courses if (one.robot, one.site) == place), None)

    def questionnaire(self, name: str) -> Definition | None:
        """Return the newest version of a questionnaire, by its name or that of a variable."""
        slug = name.partition(".")[0]
        versions = (one for one in self.questionnaires if one.slug == slug)
        return max(versions, key=lambda one: one.version, default=None)

    @property
    def withdrew(self) -> int:
        """How many withdrew, of the kinds of participants in it."""
        kinds = {one.kind for one in self.participants}
        known = self.whole.withdrew if self.whole is not None else {}
        there = sum(one.withdrawn for one in self.participants)
        return there + sum(known.get(kind, 0) for kind in kinds)

    @property
    def included(self) -> tuple[ParticipantRecord, ...]:
        """The participants who neither withdrew nor are excluded by a rule of the plan."""
        people, excluded = self.participants, self.excluded_people
        return tuple(one for one in people if not one.withdrawn and one.id not in excluded)

    @property
    def excluded_people(self) -> frozenset[str]:
        """The participants whom a rule of the plan excludes; none in a sensitivity analysis."""
        found = () if self.is_with_excluded else self.exclusions
        return frozenset(one.participant for one in found if not one.session)
