"""Why a robot waits, refuses or fails: every code, with the texts that people read.

On the wire a reason is a code, or a code, a colon and its value: `door_closed: Laboratory door`.
Lists, mail and pages put it into words where they show it (robots/readiness_text.py and
templates/sessions/_words.html). A text of an adapter that is no code is shown as it is.
"""

from collections.abc import Callable
from enum import StrEnum
from typing import Self


def _(text: str) -> str:
    """Mark a text for the catalogue; it is translated where it is shown."""
    return text


_LATE = _("The robot didn't respond in time."), _("it did not respond in time")
_NOT_YOURS = _("It isn't your turn to drive."), ""
_NAVIGATION = _("It cannot drive by itself at the moment.")


class ReasonCode(StrEnum):
    """A code, its `sentence` for the drive page, "" where that shows another text, and its `clause`
    for lists and mail, None where it is the sentence and "" where there is none. {what} is the
    value of the reason. A code without texts is only counted or recorded.
    """

    sentence: str
    clause: str | None

    def __new__(cls, code: str, sentence: str = "", clause: str | None = None) -> Self:
        made = str.__new__(cls, code)
        made._value_, made.sentence, made.clause = code, sentence, clause
        return made

    def of(self, value: object) -> str:
        """Return the reason with its value."""
        return f"{self}: {value}"

    def clause_in(self, translate: Callable[[str], str]) -> str:
        """Return the translated clause, "" without one; of a sentence, without capital and stop."""
        if self.clause is not None:
            return translate(self.clause) if self.clause else ""
        text = translate(self.sentence) if self.sentence else ""
        return text[:1].lower() + text[1:].removesuffix(".")

    # --- of navigation and docking ----------------------------------------------------------------

    DOOR_CLOSED = "door_closed", _("A door is closed: {what}."), _("a door is closed ({what})")
    DOORWAY = (
        "doorway",
        _("An obstacle blocks a doorway: {what}."),
        _("an obstacle blocks a doorway ({what})"),
    )
    IN_THE_WAY = (  # in a room
        "in_the_way",
        _("An obstacle is in the way: {what}."),
        _("an obstacle is in the way ({what})"),
    )
    ALL_BLOCKED = "all_blocked", _("Every route there is blocked.")
    BOXED_IN = "boxed_in", _("It has no room to move.")
    NO_WAY = "no_way", _("The map shows no route there.")
    GOAL_TAKEN = (  # the distance to the place that it reached, if it went beside the goal
        "goal_taken",
        _("An obstacle is on that spot. Choose one beside it."),
        _("an obstacle is on that spot"),
    )
    TOO_NARROW = "too_narrow", _("The route is too narrow for it.")
    IN_WALL = (
        "in_wall",
        _("It does not fit there. Choose a spot with more room."),
        _("it does not fit there"),
    )
    OUTSIDE = "outside", _("That is outside the map.")
    UNKNOWN_PLACE = "unknown_place"
    OUT_OF_RANGE = "out_of_range"  # the range of an angle
    NOT_IN_TIME = "not_in_time"
    DOES_NOT_START = "does_not_start"
    STOPPED_SHORT = "stopped_short"  # before it arrived
    POSE_DISAGREES = "pose_disagrees"  # the position that the robot reports instead
    NO_GOAL = "no_goal"  # without coordinates, or with some that are no numbers
    STILL_DOCKED = "still_docked", _("It is still in its charging station.")
    WAS_NOT_DOCKED = "was_not_docked"
    BEHIND = "behind", _("An obstacle is behind it.")
    # The value of these two is `Missed` of robots/agent/navigation/docking/approach.py.
    DOCK_FAILED = (
        "dock_failed",
        _("Docking failed: the charger contacts were not reached."),
        _("the charger contacts were not reached"),
    )
    TRIES_AGAIN = (
        "tries_again",
        _("The robot missed and is trying again."),
        _("it missed and is trying again"),
    )
    NO_DOCK = "no_dock", _("No charging station is known here.")
    LOOKS_FOR_DOCK = (
        "looks_for_dock",
        _("Looking for the charging station."),
        _("looking for its charging station"),
    )
    BEFORE_DOCK = (
        "before_dock",
        _("An obstacle is in front of the charging station. The robot is waiting."),
        _("an obstacle is in front of the charging station"),
    )
    PERSON_STAYED = "person_stayed", _("Someone was in the way for too long.")
    PERSON = (
        "person",
        _("Someone is in the way. The robot is waiting."),
        _("someone is in the way"),
    )
    VERY_CLOSE = (
        "very_close",
        _("An obstacle is very close. The robot is waiting."),
        _("an obstacle is very close"),
    )
    WAITS_FOR_ROUTE = (
        "waits_for_route",
        _("All routes are blocked. The robot is waiting."),
        _("all routes are blocked"),
    )
    BACKS_OFF = "backs_off", _("The robot is making room."), _("it is making room")
    NO_FARTHER = "no_farther", _("It can't go any farther.")  # the metres that are left
    NO_LASER = "no_laser", _("The laser sends no data."), _("its laser sends no data")
    NOT_FOUND = (
        "not_found",
        _("Drive a little, or set the robot's position on the map."),
        _("it has not found its position"),
    )
    LOST = "lost", _("The robot lost its position on the map."), _("it does not know where it is")
    WHEELS = "wheels", _("Its wheels aren't turning.")
    NAVIGATION_LOST = "navigation_lost", _NAVIGATION  # the value is the fault
    NAVIGATION_FAILED = "navigation_failed", _NAVIGATION
    MAP_CHANGED = "map_changed", _NAVIGATION
    AGENT_ENDS = "agent_ends", _NAVIGATION
    TOO_FAST = "too_fast", _("It drove faster than allowed.")
    NAVIGATION_DOES_NOT_END = (
        "navigation_does_not_end",
        _("Its previous drive hasn't ended yet. Wait a moment, then try again."),
        "",
    )

    # --- of a robot as a whole, and between two visits --------------------------------------------

    DOCK = "dock", "", _("driving to its charging station")
    LEVEL = "level", "", _("levelling its head")
    RELOCALIZE = "relocalize", "", _("finding its position")
    PICTURE = "picture", "", _("testing its camera")
    CHARGING = "charging", "", _("its battery is not charged enough yet")
    OFFLINE = "offline", _LATE[0], _("no signal from the robot")
    ESTOP = "estop", _("Its emergency stop is on.")
    STOPPED = "stopped", "", _("someone stopped it between visits")
    # The value is the fault.
    NOT_CONNECTED = "not_connected", _("Its control system isn't responding.")
    FAULT = "fault", _("It has a fault.")
    NETWORK = (
        "network",
        _("Its network is too slow for driving."),
        _("it responds too slowly to be driven"),
    )
    NO_PICTURE = "no_picture", _("Its camera sends no video."), _("no video from its camera")
    NOT_DOCKED = "not_docked", "", _("it is not docked")
    ELSEWHERE = "elsewhere", "", _("it is not at the charging station of the course")
    CHARGE = "charge", "", _("its battery has less charge than the study requires")
    SILENT = "silent", "", _("it has not reported its state")
    COLLISION = "collision", _("The robot has touched an obstacle. Drive back a little first."), ""

    # --- of a robot with errors, each with its technical text as the value ------------------------

    ADAPTER_LOST = "adapter_lost", "", "{what}"
    ADAPTER_STARTING = "adapter_starting", "", _("the agent is connecting to the robot")
    RIVAL = "rival", "", _("another agent runs as this robot; end one of the two")
    CLOSING = "closing", "", _("the agent is ending")
    STORE = "store", "", _("the agent cannot write to its disk: {what}")
    DISK_LOW = "disk_low", "", _("the agent's disk is nearly full: {what}")
    DISK_FULL = "disk_full", "", _("the agent's disk is full: {what}")
    CANCEL = "cancel", "", _("it is not certain that its last drive has ended: {what}")
    RUNS_ON = "runs_on", "", _("the robot keeps moving although it was told to stop")
    SETTLING = (
        "settling",
        "",
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
    # The value is the text of the robot control architecture.
    RCA = "rca", _("The robot reports: {what}."), "{what}"
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
    NO_LISTENER = "nobody_there"
    NOTHING_RUNS = "nothing_runs"
    UNKNOWN_BOOT = "unknown_boot"
    EMPTY_RANGE = "empty_range"

    # --- of a safety test; the value is what stopped the robot: silence, stop or estop ------------

    DOCKED = "docked", "", _("it is on its charging station")
    DID_NOT_MOVE = "did_not_move", "", _("it did not move, or too slowly to be measured")
    DID_NOT_STOP = "did_not_stop", "", _("it did not stop ({what})")
    TOO_LATE = "too_late", "", _("it stopped later than it must ({what})")
    NOT_HELD = "not_held", "", _("it moved although it was stopped ({what})")
    NOT_RELEASED = "not_released", "", _("the stop could not be released")


def parts_of(reason: str) -> tuple[ReasonCode | None, str]:
    """Return the code of a reason, None if it has none that is known here, and its value."""
    code, _colon, value = reason.partition(": ")
    return (ReasonCode(code), value) if code in _CODES else (None, "")


def clause_of(reason: str, translate: Callable[[str], str] = str) -> str:
    """Return a reason as a clause for people; without a known text a code with spaces, and what is
    no code as it is.
    """
    code, value = parts_of(reason)
    if code is not None and (clause := code.clause_in(translate)):
        return clause.format(what=value)
    word, colon, rest = reason.partition(": ")
    return reason if " " in word else f"{word.replace('_', ' ')}{colon}{rest}"


_CODES = frozenset(ReasonCode)
