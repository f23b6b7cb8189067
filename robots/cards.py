"""A robot on a page: one state, one sentence, one button. Pure."""

import datetime
import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

from django.utils.timesince import timesince
from django.utils.translation import gettext as _, ngettext

from robots.models import Robot
from robots.presence.report import is_stopped_there, runs_on, standstill_of

CardState = Literal["available", "busy", "stopped", "offline"]
# of a docked robot that is not ready yet: sessions/leases/readiness.py
CHECKS = frozenset({"level", "relocalize", "picture", "network"})
STATES: tuple[CardState, ...] = get_args(CardState)  # in the order of a list
PICTURES = ("giraff", "rhodon")  # the series that have a picture of their own


@dataclass(frozen=True)
class Traffic:
    """Whether a robot has a driver, who may be the reader (`own`); how many visitors wait, with the
    reader's place, 0 if the reader does not wait; and the reader's wait in minutes, None if
    unknown.
    """

    in_use: bool = False
    own: bool = False
    waiting: int = 0
    place: int = 0
    minutes: float | None = None


@dataclass(frozen=True)
class RobotCard:
    """A robot in the list, in the language of the request.

    `badge` is the style of the label: the state, or `held` for a free robot that was stopped.
    `charge` is in percent, None if unknown; `battery` is the same as text, empty if the robot is
    offline. `drives`: the button leads to driving, now or after waiting; `for_experienced`: not for
    a first drive; `own`: the reader drives it or waits for it.
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
    """Return the card of `robot`.

    Args:
        robot: with its floor plan loaded.
        traffic: its driver and queue.
        barred: why this visitor may not drive, a reason of robots.access, or empty.
        url: of the button.
        now: for "last seen".
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
    return "busy" if traffic.in_use or traffic.waiting or _away(robot) else "available"


def was_stopped(robot: Robot) -> bool:
    """Tell whether a robot was stopped between two visits (sessions/leases/readiness.py)."""
    presence = robot.presence
    is_paused = presence.turnaround == Robot.Turnaround.PAUSED
    return is_paused and presence.turnaround_reason == "stopped"


def _instead(robot: Robot, state: CardState, traffic: Traffic) -> tuple[str, str] | None:
    """Return the label and sentence of a robot whose own state matters more than its queue:
    stopped, or not ready; None otherwise.
    """
    if state == "stopped":
        return _stopped(robot)
    if state == "available" and was_stopped(robot):
        text = _(
            "Someone stopped it after the last visit. It can move again once you start to drive."
        )
        return _("Stopped"), text
    return _away(robot) if state == "busy" and not traffic.in_use else None


def _stopped(robot: Robot) -> tuple[str, str]:
    """Return the label and sentence of a robot that cannot be driven."""
    report = robot.presence.report
    match standstill_of(report):
        case "estop" if is_stopped_there(report):
            text = _("Stopped by someone next to it. They or its operators can release it.")
            return _("Stopped"), text
        case "estop":
            text = _(
                "The emergency stop is on. Somebody at the robot, or an operator, must release it."
            )
            return _("Stopped"), text
        case "not_connected":
            text = _(
                "The robot's control system isn't responding. You can drive again once it responds."
            )
        case _ if runs_on(report):
            text = _(
                "It is moving although it should stand still. You can drive it once it has stopped."
            )
        case _:
            text = _("The robot has a fault. You can drive again once it is fixed.")
    return _("Not available"), text


def _away(robot: Robot) -> tuple[str, str] | None:
    """Return the label and sentence of a robot between two visits; None when it is ready."""
    if robot.held:
        return _("Not ready"), _("Visits are paused for now. You can join the queue.")
    if not robot.returns_home or was_stopped(robot):
        return None
    presence = robot.presence
    match Robot.Turnaround(presence.turnaround):
        case Robot.Turnaround.RETURNING if presence.turnaround_reason in CHECKS:
            text = _("It is running its self-check. You can join the queue.")
            return _("Getting ready"), text
        case Robot.Turnaround.RETURNING:
            text = _("It needs to dock first. You can join the queue.")
            return _("Returning to its station"), text
        case Robot.Turnaround.CHARGING:
            return _("Charging"), _("It needs to charge first. You can join the queue.")
        case Robot.Turnaround.PAUSED:
            report = presence.report if isinstance(presence.report, dict) else {}
            text = _("The robot didn't reach its station. It tries again by itself.")
            if report.get("docked") is True:
                text = _(
                    "The robot couldn't get ready for the next visit. It tries again by itself."
                )
            return _("Not ready"), text
    return None


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
    seen_at = robot.presence.last_seen_at
    if seen_at is None:
        return _("This robot hasn't connected yet.")
    if now - seen_at < datetime.timedelta(minutes=1):
        return _("Last seen just now.")
    return _("Last seen %(time)s ago.") % {"time": timesince(seen_at, now, depth=1)}


def _line(traffic: Traffic) -> str:
    """Return the place in the queue that a new visitor would have, and the wait."""
    if traffic.minutes is None:
        if not traffic.waiting:
            return _("Somebody is driving. You would be next.")
        n = traffic.waiting
        text = ngettext("%(n)d visitor in the queue.", "%(n)d visitors in the queue.", n)
        return text % {"n": n}
    words = {"place": traffic.waiting + 1, "minutes": max(1, math.ceil(traffic.minutes))}
    if not traffic.waiting:
        return _("Somebody is driving. You would be next, in about %(minutes)d min.") % words
    text = _("You'd be number %(place)d in the queue, with a wait of about %(minutes)d min.")
    return text % words


def _own_place(traffic: Traffic) -> str:
    """Return the reader's place in the queue, and the wait."""
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
    percent = None
    if isinstance(charge, int | float) and 0.0 <= charge <= 1.0:
        percent = round(charge * 100)
    return percent, battery.get("charging") is True


def picture_of(robot: Robot) -> str:
    """Return the static file with the picture of a robot's series, or a general one."""
    factsheet = robot.presence.factsheet
    series = factsheet.get("series") if isinstance(factsheet, dict) else None
    return f"img/robots/{series if series in PICTURES else 'any'}.svg"
