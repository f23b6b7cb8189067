"""Texts for why a robot is not ready for a visit (sessions/leases/readiness.py), for the
administration, mail and the researchers' live view.
"""

import re

from django.utils.translation import gettext_lazy as _

WORDS = {
    "dock": _("driving to its charging station"),
    "level": _("levelling its head"),
    "relocalize": _("finding its position"),
    "picture": _("testing its camera"),
    "charging": _("its battery is not charged enough yet"),
    "offline": _("no signal from the robot"),
    "estop": _("its emergency stop is on"),
    "stopped": _("someone stopped it between visits"),
    "not_connected": _("its control system isn't responding"),
    "fault": _("it has a fault"),
    "network": _("it responds too slowly to be driven"),
    "no_picture": _("no video from its camera"),
    "not_docked": _("it is not docked"),
    "elsewhere": _("it is not at the charging station of the course"),
    "lost": _("it does not know where it is"),
    "charge": _("its battery has less charge than the study requires"),
    "silent": _("it has not reported its state"),
    "no_answer": _("it did not respond in time"),
}


# Sentences of our agent about navigation and docking, which are identifiers on the wire
# (docs/reference/robot-api.md). static/js/autonomy/reasons.js has the same for the drive page;
# tests/golden/reasons.json binds the two. A pattern's group is the door or room.
REASONS = tuple(
    (re.compile(pattern), name, words)
    for pattern, name, words in (
        (
            r"^(?:the charging station cannot .*: )?(?:blocked: )?(?!.* and )(.*) is closed$",
            "door_closed",
            _("a door is closed (%(what)s)"),
        ),
        (
            r"^(?:.*: )?something stands in the doorway \(([^)]*)\)$",
            "doorway",
            _("an obstacle blocks a doorway (%(what)s)"),
        ),
        (
            r"^(?!.* and )(?:.*: )?something stands in the way at \([^)]*\) in ([^:]*?)$",
            "in_the_way",
            _("an obstacle is in the way (%(what)s)"),
        ),
        (r"blocked: ", "blocked", _("every route there is blocked")),
        (r"boxed in", "boxed_in", _("it has no room to move")),
        (r"no way leads", "no_way", _("the map shows no route there")),
        (r"something stands on the goal", "goal_taken", _("an obstacle is on that spot")),
        (r"too narrow", "narrow", _("the route is too narrow for it")),
        (r"lies in a wall", "in_wall", _("it does not fit there")),
        (r"lies outside", "outside", _("that is outside the map")),
        (
            r"still in its charging station",
            "still_docked",
            _("it is still in its charging station"),
        ),
        (r"stands behind the robot", "behind", _("an obstacle is behind it")),
        (r"could not dock", "dock_failed", _("the charger contacts were not reached")),
        (r"no charging station for", "no_dock", _("no charging station is known here")),
        (
            r"looks for the charging station",
            "looks_for_dock",
            _("looking for its charging station"),
        ),
        (
            r"stands before the charging station",
            "before_dock",
            _("an obstacle is in front of the charging station"),
        ),
        (r"tries again$|backs out$", "tries_again", _("it missed and is trying again")),
        (
            r"somebody has stood in the way",
            "somebody_stayed",
            _("someone was in the way for too long"),
        ),
        (r"waits for somebody in the way", "somebody", _("someone is in the way")),
        (r"something stands very close", "very_close", _("an obstacle is very close")),
        (r"waits, because no way is free", "waits", _("all routes are blocked")),
        (r"backs off", "backs_off", _("it is making room")),
        (r"gets no farther", "no_farther", _("it can't go any farther")),
        (r"the laser\b", "laser", _("its laser sends no data")),
        (r"has not found itself", "not_found", _("it has not found its position")),
        (
            r"lost where it is|does not know where it is",
            "lost",
            _("it lost its position on the map"),
        ),
        (r"wheels do not turn", "wheels", _("its wheels aren't turning")),
        (
            r"^navigation|navigation was lost|map has changed|robot was lost|the agent ends",
            "navigation",
            _("it cannot drive by itself at the moment"),
        ),
    )
)


def reason_of(reported: str) -> tuple[str, str, str]:
    """Return the name of a reported reason, its text, and the door or room in it; three empty texts
    if the reason is unknown.
    """
    for pattern, name, words in REASONS:
        match = pattern.search(reported)
        if match is not None:
            return name, str(words), match[1] if pattern.groups else ""
    return "", "", ""


def in_words(reason: str) -> str:
    """Return the reason of a turnaround as a clause, an unknown one unchanged."""
    if reason in WORDS:
        return str(WORDS[reason])
    _name, words, what = reason_of(reason)
    return words % {"what": what} if what else words or reason
