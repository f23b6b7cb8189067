"""What the study builder calls things: a label and a hint for each field of a definition, and words
for what may be chosen.
"""

from typing import Any

from django.utils.functional import Promise
from django.utils.translation import gettext_lazy as _
from django.utils.translation import pgettext_lazy

Words = str | Promise

LABELS: dict[str, Words] = {
    "title": _("Title"),
    "intro": _("Introduction"),
    "source": _("Source"),
    "licence": _("Licence"),
    "languages": _("Languages"),
    "key": _("Short name"),
    "repeat": _("Once for each condition"),
    "text": _("Text"),
    "version": _("Version"),
    "minimum_age": _("Least age"),
    "minors": _("Who is younger"),
    "questionnaire": _("Questionnaire"),
    "leaves": _("Pages"),
    "picture": _("Picture"),
    "robot": _("Robot"),
    "minutes": _("Time limit (minutes)"),
    "last_minutes": _("Show what is left in the last (minutes)"),
    "docked_seconds": _("Docked after resting on the charger for (s)"),
    "site": _("Site"),
    "access": _("Who may be assigned"),
    "control_way": _("Way of the commands"),
    "controllers": _("Controllers"),
    "actions": _("What the robot may be asked to do"),
    "assist": _("Assistance"),
    "interface": _("Interface"),
    "speed": _("Speed limits"),
    "linear": _("Speed (m/s)"),
    "angular": _("Turning (rad/s)"),
    "doors_closed": _("Doors that are closed"),
    "network": _("Network"),
    "idle_seconds": _("Asked “Are you still there?” after (s)"),
    "control": _("Impaired towards the robot"),
    "video": _("Impaired back from the camera"),
    "delay": _("Delay (s)"),
    "jitter": _("Jitter (s)"),
    "loss": _("Loss (0-1)"),
    "reorder": _("Reordered (0-1)"),
    "bitrate": _("Bit rate (bit/s)"),
    "dock": _("Charging station"),
    "checkpoints": _("Checkpoints"),
    "x": _("x (m)"),
    "y": _("y (m)"),
    "radius": _("Radius (m)"),
    "path": _("Suggested path"),
    "doors": _("Doors to be crossed"),
    "zones": _("Zones"),
    "name": _("Short name"),
    "polygon": _("Corners"),
    "photo": _("Photo in a mirror"),
    "checkpoint": _("After checkpoint"),
    "mirror": _("Mirror"),
    "view": _("View (rad)"),
    "allocation": _("Who gets which condition"),
    "design": _("Design"),
    "order": _("Order"),
    "quota": _("Participants in a cell"),
    "start": _("Before a drive starts"),
    "docked": _("The robot is docked in its station"),
    "distance": _("Off the station, at most (m)"),
    "heading": _("Turned away, at most (rad)"),
    "charge": _("Least charge (0-1)"),
    "refill": _("Places that are given to another"),
    "outcomes": _("After these outcomes"),
    "most": _("At most, in a cell"),
    "quality": _("A good record"),
    "least_sample_rate": _("Least sample rate (Hz)"),
    "longest_gap": _("Longest gap (s)"),
    "largest_clock_offset": _("Largest clock offset (s)"),
    "condition_applied": _("The condition was in force"),
    "operator_absent": _("No operator intervened"),
    "analysis": _("Analysis"),
    "counts": _("Which of a visitor's responses counts"),
    "interval": _("Intervals of confidence"),
    "statements": _("Questionnaire that is tabled"),
}

HINTS: dict[str, Words] = {
    "languages": _(
        "Codes such as “en, es”. Every text is needed in each of them; leaving one out deletes its"
        " texts."
    ),
    "key": _("Lower-case letters, digits and underscores. It stands in the data."),
    "repeat": _("Steps that are repeated stand together, the task among them."),
    "minimum_age": _("Asked with the consent."),
    "picture": _(
        "A picture of the site's own: driving, map, task, photo, assistance. Empty: none."
    ),
    "doors_closed": _(
        "Those of the site that are closed in this condition; the others are opened."
    ),
    "idle_seconds": _("Of doing nothing. Empty: never; the time limit is enough."),
    "path": _("One point a line: x and y in metres."),
    "polygon": _("One corner a line: x and y in metres, in order; at least three."),
    "doors": _("Each is needed only where the condition leaves it open."),
    "view": _("How far the mirror may lie off the camera's axis."),
    "dock": _("Needed where the site has several for this robot."),
    "quota": _("Empty: no end. A cell is a condition, or an order of them."),
    "docked": _("Else the participant waits, and the study's researchers get a mail."),
    "charge": _("0: any. A robot that does not know its charge is taken as it is."),
    "docked_seconds": _("Still, and with the controls released. At least 1."),
    "outcomes": _("Never those of the task itself (completed, timed out)."),
    "controllers": _("What the visitor may steer with."),
    "linear": _("Below the robot's own; empty: the robot's."),
    "angular": _("Below the robot's own; empty: the robot's."),
    "statements": _("The questionnaire whose percentages are tabled."),
    "control": _(
        "Of the driver's commands; stopping is never held up. With jitter at most 0.2 s late: the"
        " robot takes nothing older."
    ),
    "video": _("Of picture and sound on their way to the driver alone."),
    "jitter": _("Up to so much more or less than the delay."),
    "reorder": _("Overtaken by the next."),
    "bitrate": _("Empty: no limit. What would wait longer than half a second is dropped."),
    "source": _("Where the study comes from; shown with its data."),
}

# By the key of the field, then by value.
CHOICES: dict[str, dict[str, Words]] = {
    "minors": {"refused": _("are turned away"), "guardian": _("need the word of a guardian")},
    "access": {"open": _("everybody with the link"), "invitation": _("those who were invited")},
    "control_way": {
        "any": _("any"),
        "datachannel": _("WebRTC alone"),
        "mqtt": _("the server alone"),
    },
    "controllers": {
        "keyboard": _("keyboard"),
        "mouse": _("mouse"),
        "touch": _("touch"),
        "stick": _("stick on the page"),
        "gamepad": _("gamepad"),
    },
    "actions": {
        "places": _("go to places"),
        "map": _("go where the map is clicked"),
        "follow": _("follow a path"),
        "dock": _("dock by itself"),
        "undock": _("leave the station by itself"),
        "tilt": _("tilt its head"),
    },
    "interface": {
        "standard": _("as it is for everybody"),
        "novice": _("novice: most help, least shown"),
        "expert": _("expert: no explanations"),
        "technical": _("technical: with the figures of the connection"),
    },
    "assist": {
        "off": _("off"),
        "slow": _("slows down and stops before obstacles"),
        "steer": _("steers round obstacles and through doors"),
    },
    "design": {
        "between": _("each participant does one condition"),
        "within": _("each participant does all conditions"),
    },
    "order": {
        "fixed": _("as they stand here"),
        "all": _("all orders"),
        "balanced": _("balanced orders"),
    },
    "counts": {"first": _("the first"), "last": _("the last"), "all": _("all")},
    "interval": {"normal": _("normal, as in the paper"), "t": _("Student's t")},
    "outcomes": {
        "completed": _("completed"),
        "timed_out": _("timed out"),
        "connection_refused": _("connection refused"),
        "cancelled": _("cancelled"),
        "stopped_by_operator": _("stopped by operator"),
        "robot_fault": _("robot fault"),
        "connection_lost": _("connection lost"),
    },
}

ITEMS: dict[str, Words] = {
    "leaves": pgettext_lazy("of the instructions", "Page"),
    "checkpoints": _("Checkpoint"),
    "zones": _("Zone"),
}

NOTHING = _("none")


def label(key: str) -> Any:
    """Return what a field is called."""
    return LABELS.get(key, key)


def hint(key: str) -> Any:
    """Return what is said below a field; empty for most."""
    return HINTS.get(key, "")


def item(key: str) -> Any:
    """Return what one part of a list is called."""
    return ITEMS.get(key, label(key))


def word(key: str, value: str) -> Any:
    """Return what a choice is called."""
    return CHOICES.get(key, {}).get(value, value or NOTHING)
