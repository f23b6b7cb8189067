"""What stands in the columns of a dataset's files: the code book, and the order in which numbers
are kept.

"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from experiments.analysis.dataset import counting, levels
from experiments.analysis.dataset.levels import METHODS, MODES, WAYS
from robots.api import docked

TIMES = (
    "Times are in seconds. Those of a session count from the moment at which the server granted the"
    " robot to the participant, by the clock that their column names; times before it are below 0."
    " An empty cell or nan is a missing value."
)
DOCKED = (
    "charger contact, standstill and no velocity from the driver for"
    f" {docked.DOCKED.seconds:g} s, as the robot reports; a robot without contacts decides it by"
    " itself"
)
# The three series of a command, and what their columns say.
SERIES = {
    "asked": "since the previous state, as the driver requested",
    "allowed": "since then, as limits and age allowed",
    "applied": "since then, as the wheels were told",
}


@dataclass(frozen=True)
class Column:
    """A column: its name in the file, the unit of its values ("" for a count, a word or a share),
    and what it says.

    One that is `late` was added when datasets had been written already: those lack it, and are read
    all the same. `least` and `greatest` bound its numbers, None where nothing does; `levels` are
    all texts that its cells may have, each with what it means, and empty where they are not listed.
    Where a cell holds several, `divider` stands between them.
    """

    name: str
    unit: str
    meaning: str
    late: bool = False
    least: float | None = None
    greatest: float | None = None
    levels: Mapping[str, str] = field(default_factory=dict)
    divider: str = ""

    def within(self, least: float | None, greatest: float | None) -> "Column":
        """Return it with the range of its values, in its unit."""
        return replace(self, least=least, greatest=greatest)

    def one_of(self, known: Mapping[str, str]) -> "Column":
        """Return it with all that its cells may say, and what each means."""
        return replace(self, levels=known)

    def some_of(self, known: Mapping[str, str], divider: str = "|") -> "Column":
        """Return it with all words of which its cells hold any number, and what each means."""
        return replace(self, levels=known, divider=divider)


def flag(name: str, meaning: str, *, late: bool = False) -> Column:
    """Return a column of 0 and 1."""
    return Column(name, "", meaning, late, levels={"0": "no", "1": "yes"})


def share(name: str, meaning: str, *, late: bool = False) -> Column:
    """Return a column of numbers from 0 to 1."""
    return Column(name, "", meaning, late, 0.0, 1.0)


def amount_of(name: str, unit: str, meaning: str, *, late: bool = False) -> Column:
    """Return a column of counts, times, distances and the like, which are never below 0."""
    return Column(name, unit, meaning, late, 0.0)


STATES = (
    Column(
        "stamp",
        "s",
        "when the robot took the state, since the grant, by the robot's clock; less clock_offset it"
        " is by the server's",
    ),
    Column(
        "received",
        "s",
        "when the server had the states of about a second with this one, since the grant, by the"
        " server's clock",
    ),
    Column("clock_offset", "s", "robot's clock minus the server's, as the server estimated then"),
    amount_of("boot", "", "run of the robot's agent: 0 for the session's first"),
    amount_of("seq", "", "number of the state within the run, from the session's first"),
    Column("x", "m", "position on the map"),
    Column("y", "m", "position on the map"),
    Column("theta", "rad", "heading on the map, counter-clockwise from x").within(
        -math.pi, math.pi
    ),
    flag("localized", "1 when the robot trusts its position"),
    share("score", "how far it trusts it: 1 is certain"),
    Column("linear", "m/s", "measured speed, forward positive"),
    Column("angular", "rad/s", "measured turn rate, counter-clockwise positive"),
    share("charge", "share of the battery's charge"),
    flag("charging", "1 while charging"),
    flag("docked", f"1 while docked: {DOCKED}"),
    Column("tilt", "rad", "tilt of the head, positive looks down"),
    Column("mode", "", "what moves the robot, by number").one_of(
        {str(number): name for number, name in enumerate(MODES)}
    ),
    amount_of("clearance", "m", "smallest distance to anything since the previous state"),
    amount_of("contacts", "", "collisions that began since the previous state"),
    amount_of("distance", "m", "odometer since the run began"),
    amount_of("silence", "s", "time since the driver's last sign of life, by the robot's clock"),
    amount_of("commands", "", "commands applied since the previous state"),
    amount_of("refused", "", "commands refused since the previous state"),
    Column("age_sum", "s", "sum of the ages of the commands applied since the previous state"),
    Column("age_max", "s", "greatest age among them"),
    Column(
        "answer_age",
        "s",
        "mean age, when they were applied, of the video frames that they answered",
    ),
    *(amount_of(f"by_{method}", "", f"how many of them came from: {method}") for method in METHODS),
    *(amount_of(f"on_{way}", "", f"how many of them came on: {way}") for way in WAYS),
    flag(
        "by_position",
        "1 when the odometer only adds up positions, as the robot has no odometry",
        late=True,
    ),
    amount_of(
        "too_old",
        "",
        "commands refused since the previous state because they, or the video frames that they "
        "answered, were too old",
        late=True,
    ),
    amount_of(
        "slowed",
        "",
        "commands applied since the previous state that the robot slowed down because of such an "
        "age; empty when the robot does not report it",
        late=True,
    ),
    *(
        Column(f"{name}_{part}", unit, f"mean {what} of the commands applied {words}", late=True)
        for name, words in SERIES.items()
        for part, unit, what in (("linear", "m/s", "speed"), ("angular", "rad/s", "turn rate"))
    ),
)

NETWORK = (
    Column(
        "stamp",
        "s",
        "when the page took the sample, since the grant, by the page's clock corrected to the"
        " server's: by the least delay of anything that it sent",
    ),
    amount_of("round_trip", "s", "round trip on the path of the commands"),
    share("loss", "share of the video packets that were lost in this second"),
    amount_of("fps", "1/s", "video frames shown in this second"),
    amount_of("bitrate", "bit/s", "bit rate of the video"),
    amount_of("freezes", "", "freezes of the video in this second"),
    amount_of("jitter", "s", "jitter of the video packets"),
    Column("frame_age", "s", "age of the video frame that was shown"),
    flag("on_datachannel", "1 when commands went over the data channel, 0 over the server"),
)

PARTICIPANTS = (
    Column("id", "", "code of the participant"),
    Column("kind", "", "who took part").one_of(levels.KINDS),
    amount_of("age", "years", "self-reported age (consent page); empty in a public dataset"),
    Column("age_band", "", "that, as a range", late=True).one_of(levels.AGE_BANDS),
    Column("cell", "", "assigned condition, or conditions in order").some_of({}, "-"),
    Column(
        "first_cell",
        "",
        "cell that was drawn first; another than `cell` where the participant saw nothing of it and"
        " was drawn again",
        late=True,
    ).some_of({}, "-"),
    amount_of("draws", "", "how often a cell was drawn", late=True),
    Column("stage", "", "last stage of the study that was reached", late=True).one_of(
        levels.STAGES
    ),
    Column(
        "place", "", "what became of the place in the cell; empty without one", late=True
    ).one_of(levels.PLACES),
    Column("reached", "", "last step of the study that was begun"),
    Column(
        "left",
        "",
        "why the participant left there; empty if they finished or are still taking part",
    ).one_of(levels.LEFT),
    flag("finished", "1 when the last step was finished"),
    flag("withdrawn", "1 when the participant withdrew: step and day remain"),
)

SESSIONS = (
    Column("id", "", "code of the session"),
    Column("participant", "", "code of its participant"),
    Column("kind", "", "who took part").one_of(levels.KINDS),
    amount_of(
        "number",
        "",
        "first, second … drive of the participant in this condition, of those in which the robot"
        " was driven and that the platform did not end; 0 for all others",
    ),
    amount_of("visit", "", "first, second … visit of the participant to the study", late=True),
    amount_of("round", "", "first, second … condition of the participant in this visit", late=True),
    flag("practice", "1 for practice, which counts nowhere"),
    flag("counts", "1 when it counts in the results on participants", late=True),
    Column("counts_why", "", "why it does not count; empty when it does", late=True).one_of(
        counting.REASONS
    ),
    Column("robot", "", "name of the robot"),
    Column("site", "", "name of the floor plan"),
    Column("condition", "", "assigned condition"),
    Column("mismatch", "", "what was not applied as assigned; empty when everything was").some_of(
        levels.MISMATCHES
    ),
    Column("control_way", "", "assigned control channel of the commands").one_of(
        levels.CONTROL_WAYS
    ),
    Column("assist", "", "assigned assistance").one_of(levels.ASSISTANCE),
    Column("doors_closed", "", "doors that were closed; empty when none was").some_of({}),
    Column(
        "control_network",
        "",
        "assigned impairment of the network towards the robot: delay and jitter in ms, loss and"
        " reorder in %, rate in kbit/s",
    ),
    Column(
        "video_network", "", "assigned impairment of the network back from its camera, likewise"
    ),
    Column(
        "control_applied", "", "the impairment towards the robot that it last reported as applied"
    ),
    Column("video_applied", "", "the impairment back from its camera, likewise"),
    Column("outcome", "", "how the session ended").one_of(levels.OUTCOMES),
    Column(
        "reason", "", "why; with free text also what an operator wrote; empty: the outcome says it"
    ).one_of(levels.END_REASONS),
    Column(
        "os", "", "operating system of the visitor's device; empty when unknown or withheld"
    ).one_of(levels.SYSTEM_NAMES),
    Column("browser", "", "browser of the visitor's device; empty when unknown or withheld").one_of(
        levels.BROWSER_NAMES
    ),
    Column("network", "", "hash of the visitor's network, for counting them"),
    Column(
        "first_frame",
        "s",
        "when the server heard from the page that it showed the first video frame, since the grant,"
        " by the server's clock; exposure and the task's time begin here; empty when the page never"
        " showed one",
    ),
    Column(
        "first_motion",
        "s",
        "when the server first had a state with a velocity of the driver that was applied and not"
        " 0, since the grant, by the server's clock; empty when the driver never moved the robot",
    ),
    Column(
        "ended",
        "s",
        "when the session ended, since the grant, by the server's clock; a lost connection or"
        " silent robot ends it when it was lost, not when waiting for it was over",
    ),
    *(
        column
        for name, word in (("began", "first"), ("ended", "last"))
        for column in (
            Column(
                f"{name}_x",
                "m",
                f"position on the map in the {word} state; empty when the robot did not know it",
                late=True,
            ),
            Column(f"{name}_y", "m", "likewise", late=True),
            Column(f"{name}_theta", "rad", "heading, likewise", late=True),
            flag(
                f"{name}_docked",
                f"1 when the robot was docked in the {word} state of the session, as in the column"
                " `docked` of the states; empty when there is none",
                late=True,
            ),
            Column(
                f"{name}_charge",
                "",
                f"share of the battery's charge in the {word} state; empty when unknown",
                late=True,
            ),
        )
    ),
    amount_of(
        "docked_seconds",
        "s",
        "how long the robot had to rest on its charging contacts to be docked; empty where one"
        " state in the station was enough",
        late=True,
    ),
    amount_of(
        "dock_contacts",
        "",
        "how often the charging contacts met after the last checkpoint; 1 is a docking that held at"
        " once; empty without that rule",
        late=True,
    ),
    flag("operator", "1 when an operator intervened"),
    amount_of("missing", "", "states that are known to be lost"),
    Column("excluded", "", "why a researcher excluded it; empty when not"),
    Column(
        "fault_side",
        "",
        "whose fault the end was; empty when nobody's",
        late=True,
    ).one_of(levels.SIDES),
    Column("fault_part", "", "part of the platform that was unavailable then", late=True).one_of(
        levels.PARTS
    ),
    *(
        Column(f"{name}_version", "", f"version of {what}", late=True)
        for name, what in levels.VERSIONED.items()
    ),
)

EVENTS = (
    Column("session", "", "code of the session"),
    Column(
        "stamp",
        "s",
        "when it happened, since the grant, by the server's clock: of robot and page by their own,"
        " corrected by its median difference to the server's (when the server heard of it, where"
        " that is a day or more); of the task when the state that it follows from was taken, or"
        " when the server heard from the page",
    ),
    Column("source", "", "what reported it").one_of(levels.SOURCES),
    Column("type", "", "what happened"),
    Column("data", "", "JSON: the rest; the levels of `type` name the fields of each"),
)

PAGES = (
    Column("participant", "", "who saw the page"),
    Column("session", "", "session that it belongs to, if any"),
    Column("step", "", "step of the study"),
    amount_of(
        "seconds",
        "s",
        "from its first display until the participant continued, by the server's clock; empty when"
        " it was not finished",
    ),
    flag("finished", "1 when the participant continued from it"),
)

ANSWERS = (
    Column("response", "", "code of the filled-in questionnaire"),
    Column("questionnaire", "", "its name"),
    amount_of("version", "", "its version"),
    Column("participant", "", "who answered"),
    Column("session", "", "session that it was asked about, if any"),
    flag("finished", "1 when it was submitted"),
    Column("item", "", "question"),
    Column("value", "", "JSON: what was answered; empty when nothing was"),
    Column(
        "missing",
        "",
        "why there is no value",
    ).one_of(levels.MISSING),
    amount_of(
        "seconds",
        "s",
        "time spent on the question, by the page's clock; at most the time since the questionnaire"
        " was opened, by the server's",
    ),
)

# Those that are written as tables, by the names of their files.
TABLES = {
    "participants": PARTICIPANTS,
    "sessions": SESSIONS,
    "events": EVENTS,
    "pages": PAGES,
    "answers": ANSWERS,
}
