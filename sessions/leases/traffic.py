"""Who drives and waits at robots, and for how long, for pages that list robots."""

import datetime
from collections.abc import Iterable
from typing import Any

from robots.cards import Traffic
from robots.models import Robot
from sessions.leases.policy import ActiveSession, Hold, Scene, minutes_until_turn, place_in_queue
from sessions.leases.store import rules_of, session_of
from sessions.models import HOLDING_STATES, Session


def living_sessions(robots: Iterable[Robot]) -> dict[Any, list[ActiveSession]]:
    """Return the living sessions of robots, by the robot's key."""
    found: dict[Any, list[ActiveSession]] = {}
    for session in Session.objects.filter(robot__in=robots).exclude(state=Session.State.ENDED):
        found.setdefault(session.robot_id, []).append(session_of(session))
    return found


def traffic_at(
    robot: Robot, sessions: list[ActiveSession], now: datetime.datetime, user: Any = None
) -> Traffic:
    """Return who is at a robot with these sessions, and how long `user` waits, or would."""
    own = None if user is None else next((s for s in sessions if s.visitor == str(user.pk)), None)
    holder = next((session for session in sessions if session.state in HOLDING_STATES), None)
    scene = Scene(Hold(0, holder.id if holder else None), tuple(sessions))
    waits = own is not None and own.state == "waiting"
    place = place_in_queue(scene, own.id if own and waits else None, now.timestamp())
    minutes = (
        minutes_until_turn(scene, place, rules_of(robot), now.timestamp()) if sessions else None
    )
    return Traffic(
        in_use=holder is not None,
        own=own is not None and not waits,
        waiting=place_in_queue(scene, None, now.timestamp()) - 1,
        place=place if waits else 0,
        minutes=minutes,
    )
