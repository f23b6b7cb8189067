"""What a page shows of a robot: one state, one sentence, one button. Pure: the caller says how many
drive and wait, and when it is.
"""

import datetime
import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

from django.utils.timesince import timesince
from django.utils.translation import gettext as _
from django.utils.translation import ngettext

from robots.models import Robot
from robots.presence.report import is_stopped_there, runs_on, standstill_of

CardState = Literal["available", "busy", "stopped", "offline"]
# of a robot that is in its station and not ready yet: sessions/leases/readiness.py
CHECKS = frozenset({"level", "relocalize", "picture", "network"})
STATES: tuple[CardState, ...] = get_args(CardState)  # in the order of a list
PICTURES = ("giraff", "rhodon")  # the series that have a picture of their own


@dataclass(frozen=True)
class Traffic:
    """Whether a robot has a driver, and whether this is the reader (`own`); how many people wait,
    and the reader's place among them, 0 for a newcomer; for how many minutes the reader waits, or
    would, None when it is not known.
    """

    driven: bool = False
    own: bool = False
    waiting: int = 0
    place: int = 0
    minutes: float | None = None


@dataclass(frozen=True)
class RobotCard:
    """A robot as the list shows it, in the language of the request.

    `badge` is the look of the label: the state, or `held` of a free robot that was stopped.
    `charge` is in percent, None when it is unknown; `battery` is the same as text, empty when the
    robot is offline. `drives`: the button leads to driving, now or in turn; `for_experienced`: not
    for a first drive; `own`: the reader drives it or waits for it.
    """

    name: str
    title: str
    description: str
    place: str
    picture: str
    state: CardState
    badge: CardState | Literal["held"]
    label: str
    detail: str
    charge: int | None
    battery: str
    action: str
    drives: bool
    for_experienced: bool
    own: bool
    url: str


def card(
    robot: Robot, traffic: Traffic, *, barred: str, url: str, now: datetime.datetime
) -> RobotCard:
    """Return what to show of `robot`.

    Args:
        robot: with its floor plan loaded.
        traffic: who drives and waits.
        barred: why this visitor may not drive, a word of robots.access, empty when they may.
        url: where the button leads.
        now: the time to measure "last seen" by.
    """
    state = _state(robot, traffic, now)
    away = _instead(robot, state, traffic)
    drives = state in {"available", "busy"} and not barred
    charge, charging = _battery(robot.presence.report) if state != "offline" else (None, False)
    return RobotCard(
        name=robot.name,
        title=robot.shown_title,
        description=robot.shown_description,
        place=robot.floor_plan.shown_title if robot.floor_plan else "",
        picture=picture_of(robot),
        state=state,
        badge="held" if state == "available" and was_stopped(robot) else state,
        label=away[0] if away else _label(state, own=traffic.own),
        detail=_barred(barred) or _detail(state, robot, traffic, now, away),
        charge=charge,
        battery="" if state == "offline" else _charge(charge, charging=charging),
        action=_action(state, robot.shown_title, traffic, drives=drives),
        drives=drives,
        for_experienced=robot.for_experienced,
        own=traffic.own or traffic.place > 0,
        url=url,
    )


def _state(robot: Robot, traffic: Traffic, now: datetime.datetime) -> CardState:
    if not robot.is_online(now):
        return "offline"
    if standstill_of(robot.presence.report):
        return "stopped"
    return "busy" if traffic.driven or traffic.waiting or _away(robot) else "available"


def was_stopped(robot: Robot) -> bool:
    """Tell whether a robot was stopped between two visits (sessions/leases/readiness.py)."""
    presence = robot.presence
    is_paused = presence.turnaround == Robot.Turnaround.PAUSED
    return is_paused and presence.turnaround_reason == "stopped"


def _instead(robot: Robot, state: CardState, traffic: Traffic) -> tuple[str, str] | None:
    """Return the label and the sentence of a robot whose own state matters more than its queue:
    stopped, or not ready; None otherwise.
    """
    if state == "stopped":
        return _stopped(robot)
    if state == "available" and was_stopped(robot):
        return _("Stopped"), _(
            "Someone stopped it after the last visit. It can move again once you start to drive."
        )
    return _away(robot) if state == "busy" and not traffic.driven else None


def _stopped(robot: Robot) -> tuple[str, str]:
    """Return the label and the sentence of a robot that cannot be driven."""
    words = {
        "estop": (
            _("Stopped"),
            _("Stopped by someone next to it. They or its operators can release it.")
            if is_stopped_there(robot.presence.report)
            else _(
                "The emergency stop is on. Somebody at the robot, or an operator, must release it."
            ),
        ),
        "not_connected": (
            _("Not available"),
            _("The robot's control system isn't responding. You can drive again once it responds."),
        ),
        "fault": (
            _("Not available"),
            _("It is moving although it should stand still. You can drive it once it has stopped.")
            if runs_on(robot.presence.report)
            else _("The robot has a fault. You can drive again once it is solved."),
        ),
    }
    return words[standstill_of(robot.presence.report)]


def _away(robot: Robot) -> tuple[str, str] | None:
    """Return what a robot does between two visits, as a label and a sentence; None when it is
    ready.
    """
    if robot.held:
        return _("Not ready"), _("Visits are paused for now. You can join the queue.")
    if not robot.returns_home or was_stopped(robot):
        return None
    words = {
        Robot.Turnaround.RETURNING: (
            (_("Getting ready"), _("It is running its self-check. You can join the queue."))
            if robot.presence.turnaround_reason in CHECKS
            else (
                _("Returning to its station"),
                _("It needs to dock first. You can join the queue."),
            )
        ),
        Robot.Turnaround.CHARGING: (
            _("Charging"),
            _("It needs to charge first. You can join the queue."),
        ),
        Robot.Turnaround.PAUSED: (
            _("Not ready"),
            _("The robot couldn't get ready for the next visit. It tries again by itself.")
            if isinstance(robot.presence.report, dict)
            and robot.presence.report.get("docked") is True
            else _("The robot didn't reach its station. It tries again by itself."),
        ),
    }
    return words.get(Robot.Turnaround(robot.presence.turnaround))


def _label(state: CardState, *, own: bool) -> str:
    if own and state == "busy":
        return _("You are driving it")
    words = {"available": _("Free now"), "busy": _("In use"), "offline": _("Offline")}
    return words[state]


def _detail(
    state: CardState,
    robot: Robot,
    traffic: Traffic,
    now: datetime.datetime,
    away: tuple[str, str] | None,
) -> str:
    if state == "busy" and traffic.place:
        return _own_place(traffic)
    if away:
        return away[1]
    if state == "available":
        ready = _("Ready when you are.")
        return ready if robot.shown_to_visitors else _("Ready, but hidden from visitors.")
    if state == "busy":
        return _("Your drive is not over yet.") if traffic.own else _line(traffic)
    if robot.presence.last_seen_at is None:
        return _("This robot hasn't connected yet.")
    if now - robot.presence.last_seen_at < datetime.timedelta(minutes=1):
        return _("Last seen just now.")
    return _("Last seen %(time)s ago.") % {
        "time": timesince(robot.presence.last_seen_at, now, depth=1)
    }


def _line(traffic: Traffic) -> str:
    """Return which place in the queue one would have, and for how long."""
    if traffic.minutes is None:
        if not traffic.waiting:
            return _("Somebody is driving. You would be next.")
        return ngettext(
            "%(n)d visitor in the queue.", "%(n)d visitors in the queue.", traffic.waiting
        ) % {"n": traffic.waiting}
    words = {"place": traffic.waiting + 1, "minutes": max(1, math.ceil(traffic.minutes))}
    if not traffic.waiting:
        return _("Somebody is driving. You would be next, in about %(minutes)d min.") % words
    return (
        _("You'd be number %(place)d in the queue, with a wait of about %(minutes)d min.") % words
    )


def _own_place(traffic: Traffic) -> str:
    """Return which place the reader has in the queue, and for how long."""
    if traffic.minutes is None:
        return _("You are number %(place)d in the queue.") % {"place": traffic.place}
    words = {"place": traffic.place, "minutes": max(1, math.ceil(traffic.minutes))}
    return _("You are number %(place)d in the queue, with a wait of about %(minutes)d min.") % words


def _barred(reason: str) -> str:
    words = {
        "not_invited": _("By invitation from its owner."),
        "not_trained": _("For trained users."),
        "disabled": _("Disabled by its owner."),
    }
    return words.get(reason, "")


def _action(state: CardState, title: str, traffic: Traffic, *, drives: bool) -> str:
    if not drives:
        return _("Open its page")
    if traffic.own:
        return _("Back to your drive")
    if traffic.place and state == "busy":
        return _("Back to the queue")
    return _("Join the queue") if state == "busy" else _("Drive %(robot)s") % {"robot": title}


def _charge(charge: int | None, *, charging: bool) -> str:
    if charge is None:
        return _("Battery unknown, charging") if charging else _("Battery unknown")
    return (_("%(n)d %%, charging") if charging else _("%(n)d %%")) % {"n": charge}


def _battery(report: Any) -> tuple[int | None, bool]:
    reported = report.get("battery") if isinstance(report, dict) else None
    battery = reported if isinstance(reported, dict) else {}
    charge = battery.get("charge")
    percent = (
        round(charge * 100) if isinstance(charge, int | float) and 0.0 <= charge <= 1.0 else None
    )
    return percent, battery.get("charging") is True


def picture_of(robot: Robot) -> str:
    """Return the static file with the picture of a robot's series, or one of any robot."""
    factsheet = robot.presence.factsheet
    series = factsheet.get("series") if isinstance(factsheet, dict) else None
    return f"img/robots/{series if series in PICTURES else 'any'}.svg"
