"""Why a robot waits, refuses or fails: every code, with the texts that people read.

On the wire a reason is a code, or a code, a colon and its value: `door_closed: Laboratory door`.
Lists, mail and pages put it into words where they show it (robots/readiness_text.py and, by
`reason_words`, the drive page). A text of an adapter that is no code is shown as it is.
"""

from collections.abc import Callable
from enum import StrEnum
from typing import Self


def _(text: str) -> str:
    """Mark a text for the catalogue; it is translated where it is shown."""
    return text


_LATE = _("it did not respond in time"), _("The robot didn't respond in time.")
_NOT_YOURS = "", _("It isn't your turn to drive.")
_NAVIGATION = (
    _("it cannot drive by itself at the moment"),
    _("It cannot drive by itself at the moment."),
)


class ReasonCode(StrEnum):
    """A code, its `clause` for lists and mail, and its `sentence` for the page that drives, where
    {what} is the value of the reason; empty where a code is only counted or recorded.
    """

    clause: str
    sentence: str

    def __new__(cls, code: str, clause: str = "", sentence: str = "") -> Self:
        made = str.__new__(cls, code)
        made._value_, made.clause, made.sentence = code, clause, sentence
        return made

    def of(self, value: object) -> str:
        """Return the reason with its value."""
        return f"{self}: {value}"

    # --- of navigation and docking ----------------------------------------------------------------

    DOOR_CLOSED = "door_closed", _("a door is closed ({what})"), _("A door is closed: {what}.")
    DOORWAY = (
        "doorway",
        _("an obstacle blocks a doorway ({what})"),
        _("An obstacle blocks a doorway: {what}."),
    )
    IN_THE_WAY = (  # in a room
        "in_the_way",
        _("an obstacle is in the way ({what})"),
        _("An obstacle is in the way: {what}."),
    )
    ALL_BLOCKED = (
        "all_blocked",
        _("every route there is blocked"),
        _("Every route there is blocked."),
    )
    BOXED_IN = "boxed_in", _("it has no room to move"), _("It has no room to move.")
    NO_WAY = "no_way", _("the map shows no route there"), _("The map shows no route there.")
    GOAL_TAKEN = (  # the distance to the place that it reached, if it went beside the goal
        "goal_taken",
        _("an obstacle is on that spot"),
        _("An obstacle is on that spot. Choose one beside it."),
    )
    TOO_NARROW = (
        "too_narrow",
        _("the route is too narrow for it"),
        _("The route is too narrow for it."),
    )
    IN_WALL = (
        "in_wall",
        _("it does not fit there"),
        _("It does not fit there. Choose a spot with more room."),
    )
    OUTSIDE = "outside", _("that is outside the map"), _("That is outside the map.")
    UNKNOWN_PLACE = "unknown_place"
    OUT_OF_RANGE = "out_of_range"  # the range of an angle
    NOT_IN_TIME = "not_in_time"
    DOES_NOT_START = "does_not_start"
    STOPPED_SHORT = "stopped_short"  # before it arrived
    POSE_DISAGREES = "pose_disagrees"  # the position that the robot reports instead
    NO_GOAL = "no_goal"  # without coordinates, or with some that are no numbers
    STILL_DOCKED = (
        "still_docked",
        _("it is still in its charging station"),
        _("It is still in its charging station."),
    )
    WAS_NOT_DOCKED = "was_not_docked"
    BEHIND = "behind", _("an obstacle is behind it"), _("An obstacle is behind it.")
    DOCK_FAILED = (  # the last of MISSED
        "dock_failed",
        _("the charger contacts were not reached"),
        _("Docking failed: the charger contacts were not reached."),
    )
    NO_DOCK = (
        "no_dock",
        _("no charging station is known here"),
        _("No charging station is known here."),
    )
    LOOKS_FOR_DOCK = (
        "looks_for_dock",
        _("looking for its charging station"),
        _("Looking for the charging station."),
    )
    BEFORE_DOCK = (
        "before_dock",
        _("an obstacle is in front of the charging station"),
        _("An obstacle is in front of the charging station. The robot is waiting."),
    )
    TRIES_AGAIN = (  # why it missed: see robots/agent/navigation/docking/approach.py
        "tries_again",
        _("it missed and is trying again"),
        _("The robot missed and is trying again."),
    )
    SOMEBODY_STAYED = (
        "somebody_stayed",
        _("someone was in the way for too long"),
        _("Someone was in the way for too long."),
    )
    SOMEBODY = (
        "somebody",
        _("someone is in the way"),
        _("Someone is in the way. The robot is waiting."),
    )
    VERY_CLOSE = (
        "very_close",
        _("an obstacle is very close"),
        _("An obstacle is very close. The robot is waiting."),
    )
    WAITS_FOR_ROUTE = (
        "waits_for_route",
        _("all routes are blocked"),
        _("All routes are blocked. The robot is waiting."),
    )
    BACKS_OFF = "backs_off", _("it is making room"), _("The robot is making room.")
    NO_FARTHER = "no_farther", _("it can't go any farther"), _("It can't go any farther.")
    NO_LASER = "no_laser", _("its laser sends no data"), _("The laser sends no data.")
    NOT_FOUND = (
        "not_found",
        _("it has not found its position"),
        _("Drive a little, or set the robot's position on the map."),
    )
    LOST = "lost", _("it does not know where it is"), _("The robot lost its position on the map.")
    WHEELS = "wheels", _("its wheels aren't turning"), _("Its wheels aren't turning.")
    NAVIGATION_LOST = "navigation_lost", *_NAVIGATION  # the value is the fault
    NAVIGATION_FAILED = "navigation_failed", *_NAVIGATION
    MAP_CHANGED = "map_changed", *_NAVIGATION
    AGENT_ENDS = "agent_ends", *_NAVIGATION
    TOO_FAST = "too_fast", _("it drove faster than allowed"), _("It drove faster than allowed.")
    NAVIGATION_DOES_NOT_END = (
        "navigation_does_not_end",
        "",
        _("Its previous drive hasn't ended yet. Wait a moment, then try again."),
    )

    # --- of a robot as a whole, and between two visits --------------------------------------------

    DOCK = "dock", _("driving to its charging station")
    LEVEL = "level", _("levelling its head")
    RELOCALIZE = "relocalize", _("finding its position")
    PICTURE = "picture", _("testing its camera")
    CHARGING = "charging", _("its battery is not charged enough yet")
    OFFLINE = "offline", _("no signal from the robot"), _LATE[1]
    ESTOP = "estop", _("its emergency stop is on"), _("Its emergency stop is on.")
    STOPPED = "stopped", _("someone stopped it between visits")
    NOT_CONNECTED = (  # the value is the fault
        "not_connected",
        _("its control system isn't responding"),
        _("Its control system isn't responding."),
    )
    FAULT = "fault", _("it has a fault"), _("It has a fault.")
    NETWORK = (
        "network",
        _("it responds too slowly to be driven"),
        _("Its network is too slow for driving."),
    )
    NO_PICTURE = "no_picture", _("no video from its camera"), _("Its camera sends no video.")
    NOT_DOCKED = "not_docked", _("it is not docked")
    ELSEWHERE = "elsewhere", _("it is not at the charging station of the course")
    CHARGE = "charge", _("its battery has less charge than the study requires")
    SILENT = "silent", _("it has not reported its state")
    COLLISION = (
        "collision",
        "",
        _("The robot has touched an obstacle. Drive back a little first."),
    )

    # --- of a robot with errors, each with its technical text as the value ------------------------

    ADAPTER_LOST = "adapter_lost", "{what}"
    ADAPTER_STARTING = "adapter_starting", _("the agent is connecting to the robot")
    RIVAL = "rival", _("another agent runs as this robot; end one of the two")
    CLOSING = "closing", _("the agent is ending")
    STORE = "store", _("the agent cannot write to its disk: {what}")
    DISK_LOW = "disk_low", _("the agent's disk is nearly full: {what}")
    DISK_FULL = "disk_full", _("the agent's disk is full: {what}")
    CANCEL = "cancel", _("it is not certain that its last drive has ended: {what}")
    RUNS_ON = "runs_on", _("the robot keeps moving although it was told to stop")
    SETTLING = (
        "settling",
        _("it is never measured at rest; its standstill thresholds must be set"),
    )

    # --- of a single command: docs/explanation/safety.md ------------------------------------------

    NO_ANSWER = "no_answer", *_LATE
    STALE = "stale", *_LATE
    FUTURE = "future", *_LATE
    CLOCK_UNKNOWN = "clock_unknown", *_LATE
    HEARTBEAT_LOST = "heartbeat_lost", *_LATE
    FAILED = "failed", *_LATE
    NO_LEASE = "no_lease", *_NOT_YOURS
    OBSERVER = "observer", *_NOT_YOURS
    WRONG_SESSION = "wrong_session", *_NOT_YOURS
    WRONG_EPOCH = "wrong_epoch", *_NOT_YOURS
    LEASE_CHANGED = "lease_changed", *_NOT_YOURS
    NOT_DRIVER = "not_driver", *_NOT_YOURS
    ROLE = "role"
    ROBOT_UNREACHABLE = "robot_unreachable"
    NOT_ALLOWED = "not_allowed"
    NOT_FROM_SERVER = "not_from_server"
    UNSUPPORTED = "unsupported"
    RCA = (  # the value is the text of the robot control architecture
        "rca",
        "{what}",
        _("The robot reports: {what}."),
    )
    RETAINED = "retained"
    REPLACED = "replaced"
    CANCELLED = "cancelled"
    MANUAL = "manual"
    BUSY = "busy"
    NAVIGATING = "navigating"
    UNCONFIRMED = "unconfirmed"
    OLD_SEQ = "old_seq"
    OLD_LEASE = "old_lease"
    TOO_MANY = "too_many"
    TOO_LARGE = "too_large"
    NO_FRAME = "no_frame"
    FRAME_STALE = "frame_stale"
    FRAME_FUTURE = "frame_future"
    BUTTON_PRESSED = "button_pressed"
    OWNER_ONLY = "owner_only"
    NOT_YOURS = "not_yours"
    NOBODY_THERE = "nobody_there"
    NOTHING_RUNS = "nothing_runs"
    UNKNOWN_BOOT = "unknown_boot"
    EMPTY_RANGE = "empty_range"


def parts_of(reason: str) -> tuple[ReasonCode | None, str]:
    """Return the code of a reason, None if it has none that is known here, and its value."""
    code, _colon, value = reason.partition(": ")
    return (ReasonCode(code), value) if code in _CODES else (None, "")


def clause_of(reason: str, translate: Callable[[str], str] = str) -> str:
    """Return a reason as a clause for people; without a known text a code with spaces, and what is
    no code as it is.
    """
    code, value = parts_of(reason)
    if code is not None and code.clause:
        return translate(code.clause).format(what=value)
    word, colon, rest = reason.partition(": ")
    return reason if " " in word else f"{word.replace('_', ' ')}{colon}{rest}"


_CODES = frozenset(ReasonCode)
