"""The words that coded columns may hold, and what each means. The words are those of the
enumerations in the code; one that is added there needs its meaning here before anything starts.
"""

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Literal, get_args

from experiments.definition.conditions import ASPECTS
from experiments.definition.design import ControlWay
from experiments.definition.plan import Fault
from experiments.definition.schema import Outcome
from robots.api.messages import AssistLevel, InputMethod, Mode, Way
from sessions.devices import OTHER, SYSTEMS, TABLE_3_BROWSERS
from sessions.leases.fault_side import MANAGER, WEB, Side
from surveys.answers import Missing

Kind = Literal["participant", "pilot", "bot"]
Levels = Mapping[str, str]
MODES: tuple[str, ...] = get_args(Mode)
METHODS: tuple[str, ...] = get_args(InputMethod)
WAYS: tuple[str, ...] = get_args(Way)
TURNED_AWAY = "screened out"
WITHDREW = "withdrew"
PLATFORM = "platform"  # the side of a fault that keeps a session out of every result
WITHHELD = "withheld"  # why a value is missing that was given, and tells who gave it


def explained(words: Iterable[str], /, **meanings: str) -> Levels:
    """Return words with their meanings; a word without one is a KeyError."""
    return {word: meanings[word] for word in words if word}


KINDS = explained(
    get_args(Kind),
    participant="took part in the study",
    pilot="tried the study out; counts in no result",
    bot="a program that took part in place of a person; counts in no result",
)
OUTCOMES = explained(
    get_args(Outcome),
    completed="the task was completed",
    timed_out="its time or the turn was over, or the driver gave no sign any more",
    connection_refused="the page never reached the robot",
    cancelled="the visitor left",
    stopped_by_operator="an operator ended it, or the robot was switched off for visitors",
    robot_fault="the robot was silent or had a fault",
    connection_lost="the visitor's connection was lost and did not come back in time",
)
# Why a session ended (sessions/leases/, sessions/manager/, experiments/tasks/). What an operator
# wrote is free text.
END_REASONS: Levels = {
    "begins_anew": "the visitor began another session",
    "idle": "the driver gave no sign for as long as the condition allows",
    "lease_gone": "the server no longer knew who drives",
    "left": "the visitor left",
    "left_queue": "the visitor left before having the robot",
    "maintenance": "the site's maintenance began",
    "never_connected": "the page was open and did not reach the robot in time",
    "no_picture": "no video frame was shown in time",
    "page_gone": "the page was closed before it had reached the robot",
    "robot_disabled": "the robot was switched off for visitors",
    "robot_offline": "the robot was silent for too long",
    "terms_unreadable": "the server could not read what was fixed for the session",
    "task": "the task ended it: completed, or its time was over",
    "time_over": "the time for practice was over",
    "turn_not_taken": "the robot was offered and not taken",
    "turn_over": "the time with the robot was over",
    "visitor_silent": "nothing came from the visitor's page for too long",
    "withdrawn": "the participant withdrew",
}
LEFT = {
    TURNED_AWAY: "was not eligible",
    WITHDREW: "withdrew the consent",
    **{word: OUTCOMES[word] for word in OUTCOMES if word not in {"completed", "timed_out"}},
}
# The youngest age of each range but the first, in years.
AGE_LIMITS = (18, 25, 35, 45, 55, 65)
AGE_BANDS = {
    f"below {AGE_LIMITS[0]}": "younger",
    **{
        f"{low}–{high - 1}": f"at least {low} and younger than {high}"
        for low, high in pairwise(AGE_LIMITS)
    },
    f"{AGE_LIMITS[-1]} or above": "at least that old",
}
# What became of a place in a cell (experiments/participation/assignment.py).
REPLACED = "refilled"
PLACES = {
    "under_way": "the participant holds it and has conditions to drive",
    "freed": "it was given back, because the participant was not exposed",
    "filled": "the participant was exposed",
    REPLACED: "the participant was exposed, and the place was given to another participant",
}
STAGES = {
    "arrived": "came to the study",
    "assigned": "was assigned to a condition, or to an order of them",
    "exposed": "saw the robot's video in the task",
    "drove": "and moved the robot in it",
    "ended": "and such a drive ended with an outcome",
    "answered": "and finished the questionnaire of the table",
}
# What a drive was made with, as far as it is known.
VERSIONED = {
    "server": "version of the server's software when the robot was granted",
    "agent": "version of the robot's agent",
    "adapter": "name and version of the agent's adapter to the robot's control architecture",
    "driver": "name and version of the robot's own driver, as its adapter reports",
    "metrics": "version of the definitions of result and metrics at the end of the drive",
    "definition": "SHA-256 of the study's definition",
}
CONTROL_WAYS = explained(
    get_args(ControlWay),
    any="the data channel, or the server where there is none",
    datachannel="the data channel from the page to the robot (WebRTC)",
    mqtt="over the server and its broker (MQTT)",
)
ASSISTANCE = explained(
    get_args(AssistLevel),
    off="none: the participant drives",
    slow="slows down and stops at obstacles",
    steer="steers around obstacles and through doors",
)
MISMATCHES = explained(
    ASPECTS,
    robot="another robot was driven",
    site="it was on another floor plan",
    control_way="commands came over another channel than the condition's",
    controllers="the participant drove with a controller that the condition does not allow",
    actions="the participant used an action that the condition does not allow",
    assist="the robot drove with another assistance",
    interface="the page had another interface",
    speed="a command was applied that is faster than the condition's speed",
    doors_closed="other doors were closed",
    network="the network had another impairment",
)
SIDES = explained(
    get_args(Side),
    visitor="left, closed the page, or gave no sign",
    network="the connection was lost or never came about, and nothing else explains it",
    platform="the server was away; such a session counts nowhere",
    robot="was silent or had a fault",
    operator="ended the session",
)
PARTS = {WEB: "the process that serves pages", MANAGER: "the process that manages sessions"}
SOURCES = {
    "task": "the engine that follows the task",
    "server": "the server",
    "robot": "the robot",
    "page": "the visitor's page",
    "lab": "another stream of a laboratory (Lab Streaming Layer)",
}
SYSTEM_NAMES = dict.fromkeys((*sorted(SYSTEMS), OTHER), "")
BROWSER_NAMES = dict.fromkeys((*sorted(TABLE_3_BROWSERS), OTHER), "")
PRACTICE, WITHDRAWN, PLATFORM_FAULT = "practice", "withdrawn", "platform_fault"
RUNNING, NOT_EXPOSED, NOT_DRIVEN = "running", "not_exposed", "not_driven"
EXCLUDED, EXCLUDED_BY_PLAN, FAULTY = "excluded", "excluded_by_plan", "faulty"
ATTENTION, SPEEDER, INCOMPLETE = "attention check", "speeder", "incomplete"
DRAWN_ANEW, REPEATED = "drawn_anew", "repeated"
# Why a drive does not count, by code, in the order in which the reasons are looked for.
UNCOUNTED: Levels = {
    PRACTICE: "it was practice",
    "pilot": "a pilot's drive, and pilots were not chosen",
    "bot": "a bot's drive, and bots were not chosen",
    "participant": "a participant's drive, and participants were not chosen",
    WITHDRAWN: "the participant withdrew",
    PLATFORM_FAULT: "the platform ended it",
    RUNNING: "it has not ended",
    NOT_EXPOSED: "the page showed no video frame of the task",
    EXCLUDED: "a researcher excluded it",
    EXCLUDED_BY_PLAN: "a rule of the plan excludes the participant",
    FAULTY: "the plan excludes it for a fault of its record",
    NOT_DRIVEN: "the participant saw the video and never moved the robot; without a drive under the"
    " condition that counts, a failure in tests of proportions, and censored in those of times",
    INCOMPLETE: "a rule of the plan excludes the participant, who lacks a drive or a questionnaire;"
    " only tests of proportions and times have the drive",
    DRAWN_ANEW: "the participant was drawn anew and has a drive that counts in another cell",
    REPEATED: "the study counts another drive of the participant in this condition",
}
OF_PLATFORM, BY_HAND = "platform fault", "researcher's decision"
FAULT = "fault of the record"  # followed by its name
FAULTS = explained(
    get_args(Fault),
    no_states="the robot was driven, and there are no states",
    rate="fewer states a second than the study asks for",
    gap="a longer time without a state than the study allows",
    clock_unknown="the clock offset was never measured",
    clock="the clocks differed by more than the study allows",
    condition="the condition was not applied as assigned",
    operator="an operator intervened",
    frozen_video="no new video frame in a fifth of the seconds, or more",
)
RULES = {
    ATTENTION: "of the plan: the participant answered an attention check otherwise",
    SPEEDER: "of the plan: the participant answered a questionnaire too fast",
    INCOMPLETE: "of the plan: an exposed participant lacks a condition or a questionnaire",
    **{f"{FAULT}: {name}": f"of the plan: {why}" for name, why in FAULTS.items()},
    OF_PLATFORM: "the platform ended the session",
    BY_HAND: "a researcher excluded the session",
}
MISSING = {
    **explained(
        Missing,
        skipped="left empty",
        preferred_not="“Prefer not to answer” was chosen",
        not_applicable="“Does not apply” was chosen",
        not_asked="not shown, by a condition of the questionnaire",
        not_reached="the participant did not get that far",
    ),
    WITHHELD: "there is an answer, which would reveal too much",
}
