"""A robot's status for its owner: colour, label, and a sentence with the state and what to do.
Pure; robots/cards.py has the status for visitors.
"""

import datetime
from dataclasses import dataclass
from typing import Any, Literal

from django.utils.translation import gettext as _

from robots.cards import RobotCard, Traffic, card, was_stopped
from robots.models import Robot
from robots.presence.report import fault_of, is_stopped_there, standstill_of, trouble_of
from robots.readiness_text import in_words

# The colours of the page: ready, working, needs the owner, not usable, switched off.
Tone = Literal["good", "busy", "attention", "bad", "off"]


@dataclass(frozen=True)
class OwnerStatus:
    """In the language of the request. `battery` is empty while the robot is offline; `connected`
    tells whether it was ever online.
    """

    tone: Tone
    label: str
    sentence: str
    battery: str
    connected: bool


def owner_status(robot: Robot, *, in_use: bool, now: datetime.datetime) -> OwnerStatus:
    """Return the status of `robot`, with its floor plan, at `now`; `in_use`: it has a driver."""
    shown = card(robot, Traffic(in_use=in_use), barred="", url="", now=now)
    tone, label, sentence = _away(robot, shown) or _present(robot, shown, in_use=in_use)
    return OwnerStatus(
        tone, label, sentence, shown.battery, robot.presence.last_seen_at is not None
    )


def _away(robot: Robot, shown: RobotCard) -> tuple[Tone, str, str] | None:
    """Return the state of a robot that is not connected; None when it is."""
    if not robot.enabled:
        return "off", _("Disabled"), _("It can't connect. Select “Enabled” below and save.")
    if robot.presence.last_seen_at is None:
        sentence = _("It hasn't connected yet. Run the command below on the robot's computer.")
        return "off", _("New"), sentence
    if shown.state != "offline":
        return None
    if not robot.credentials.credential_hash:
        sentence = _(
            "It has no credentials and can't connect. Create a command below and run it on the "
            "robot's computer."
        )
        return "bad", shown.label, sentence
    check = _(
        "Check that its computer is on and connected to the network, then run the command below."
    )
    return "bad", shown.label, f"{shown.detail} {check}"


def _present(robot: Robot, shown: RobotCard, *, in_use: bool) -> tuple[Tone, str, str]:
    """Return the state of a robot that is connected."""
    if standstill_of(robot.presence.report):
        return "bad", shown.label, _standstill(robot.presence.report)
    if in_use:
        sentence = _("Somebody is driving. You can watch on its drive page.")
        return "busy", shown.label, sentence
    if shown.state == "busy":
        return _between(robot, shown)
    if was_stopped(robot):
        sentence = _(
            "Someone stopped it after the last visit. It stays there until somebody releases it or "
            "drives it."
        )
        return "attention", shown.label, sentence
    if not robot.shown_to_visitors:
        sentence = _("Ready, but hidden from visitors. Select “Show to visitors” below and save.")
        return "attention", _("Hidden"), sentence
    return "good", shown.label, _("Connected and ready for visitors.")


def _standstill(report: Any) -> str:
    """Return why a connected robot cannot be driven, and what to do."""
    why = standstill_of(report)
    if why == "not_connected":
        sentence = _(
            "Its control system isn't responding: %(why)s. Check that the control system is "
            "running. The agent reconnects by itself."
        )
        return sentence % {"why": trouble_of(report)}
    if why == "fault":
        fault = fault_of(report) or _("not specified")
        return _("Has a fault: %(why)s. Nobody can drive it until it is fixed.") % {"why": fault}
    if is_stopped_there(report):
        return _("Stopped by someone next to it. Release it at the robot or on its drive page.")
    return _("The emergency stop is on. Release it at the robot or on its drive page.")


def _between(robot: Robot, shown: RobotCard) -> tuple[Tone, str, str]:
    """Return the state of a robot that accepts no visitor although it has no driver."""
    if robot.held:
        sentence = _("A researcher paused visits: %(why)s. Resume them in the study's live view.")
        return "attention", shown.label, sentence % {"why": robot.held}
    if robot.presence.turnaround == Robot.Turnaround.PAUSED:
        sentence = _(
            "It couldn't get ready for the next visit: %(why)s. It tries again by itself. If it "
            "can't, put it in its charging station."
        )
        why = in_words(robot.presence.turnaround_reason)
        return "attention", shown.label, sentence % {"why": why}
    return "busy", shown.label, _("It accepts visitors again as soon as it is ready.")
