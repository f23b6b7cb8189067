"""The JSON API for other programs, version 1, as described in docs/reference/json-api.md.

Robots that are public on the site can be read without a key. A key (sessions/api/keys.py) belongs
to one robot: it also reads that robot's state, and may stop it or send it to its station. It cannot
drive: leases are for persons.
"""

import datetime
import functools
import time
import uuid
from collections.abc import Awaitable, Callable
from typing import Any, Literal, get_args

import msgspec
from channels.db import database_sync_to_async
from django.db.models import Count, Q
from django.http import HttpRequest, JsonResponse
from django.urls import reverse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.csrf import csrf_exempt
from django.views.decorators.http import require_POST, require_safe

from accounts.attempts import Attempts, address_of
from accounts.json_api import VERSION, problem, too_many
from robots.access import robots_visible_to
from robots.api.messages import EStop, Stop
from robots.bridge import bridge as mqtt_bridge
from robots.cards import was_stopped
from robots.models import Robot, RobotPresence
from robots.presence.report import standstill_of
from sessions import system_log
from sessions.api.keys import key_of, note_use
from sessions.leases.store import LIVE, waits_here
from sessions.models import HOLDING_STATES, ApiKey, Session

REFUSED = Attempts("api-refused", limit=20)
ACTED = Attempts("api-acted", limit=30)
READ = Attempts("api-read", limit=120)
ActionKind = Literal["stop", "estop", "dock"]
MAX_BODY = 1024
BROKER_PATIENCE_SECONDS = 1.0


def _key_or_problem(request: HttpRequest) -> ApiKey | JsonResponse | None:
    """Return the key of a request, None without one, or the answer to a wrong one."""
    header = request.headers.get("Authorization", "")
    if not header:
        return None
    address, now = address_of(request), time.time()
    if not REFUSED.are_left(address, now):
        return too_many(REFUSED, address, now)
    key = key_of(header)
    if key is None:
        REFUSED.count(address, now)
        return problem(
            401, "wrong_key", "Send “Authorization: Bearer KEY” with a key of a robot, or none."
        )
    note_use(key, timezone.now())
    return key


# --- reading --------------------------------------------------------------------------------------


def _reader(request: HttpRequest) -> ApiKey | JsonResponse | None:
    address, now = address_of(request), time.time()
    if not READ.count(address, now):
        return too_many(READ, address, now)
    return _key_or_problem(request)


@never_cache
@require_safe
def robots(request: HttpRequest) -> JsonResponse:
    """List the robots that the client may see, by name."""
    key = _reader(request)
    if isinstance(key, JsonResponse):
        return key
    now = timezone.now()
    traffic = _traffic(Session.objects.all(), now)
    listed = [
        _described(request, row, key, traffic.get(row.pk, (0, 0)), now)
        for row in _visible(request, key).order_by("name")
    ]
    return JsonResponse({"apiVersion": VERSION, "robots": listed})


@never_cache
@require_safe
def robot(request: HttpRequest, robot: str) -> JsonResponse:
    """Describe one robot."""
    key = _reader(request)
    if isinstance(key, JsonResponse):
        return key
    now = timezone.now()
    row = _visible(request, key).filter(name=robot).first()
    if row is None:
        return problem(404, "no_such_robot", "There is no robot of this name that you can access.")
    traffic = _traffic(row.sessions, now).get(row.pk, (0, 0))
    return JsonResponse(
        {"apiVersion": VERSION, "robot": _described(request, row, key, traffic, now)}
    )


def _visible(request: HttpRequest, key: ApiKey | None) -> Any:
    own = Q() if key is None else Q(pk=key.robot_id)
    visible = robots_visible_to(request.user).filter(practice=False).values("pk")
    rows = Robot.objects.filter(Q(pk__in=visible) | own)
    return rows.select_related("floor_plan").defer("floor_plan__image")


def _traffic(sessions: Any, now: datetime.datetime) -> dict[Any, tuple[int, int]]:
    """Return how many visitors (drive, wait), by the robot's key; robots without any are absent."""
    living = sessions.filter(state__in=LIVE).order_by()
    counts = living.values("robot").annotate(
        driving=Count("pk", filter=Q(state__in=HOLDING_STATES)),
        waiting=Count("pk", filter=waits_here(now)),
    )
    return {row["robot"]: (row["driving"], row["waiting"]) for row in counts}


def _described(
    request: HttpRequest,
    row: Robot,
    key: ApiKey | None,
    traffic: tuple[int, int],
    now: datetime.datetime,
) -> dict[str, Any]:
    """Return a robot's fields in the JSON API: those that its report decides are null while it is
    offline; pose, safety and errors are for the robot's own key.
    """
    driving, waiting = traffic
    online = row.is_online(now)
    report = (row.presence.report or {}) if online else {}
    battery = report.get("battery") or {}
    fields = {
        "name": row.name,
        "title": row.title,
        "description": row.description,
        "state": _state(row, report, busy=any(traffic), online=online),
        "online": online,
        "lastSeenAt": row.presence.last_seen_at and row.presence.last_seen_at.isoformat(),
        "driven": bool(driving),
        "waiting": waiting,
        "turnaround": row.presence.turnaround,
        "charge": battery.get("charge"),
        "charging": battery.get("charging", False) if battery else None,
        "docked": report.get("docked", False) if report else None,
        **_fixed(request, row),
    }
    if key is not None and key.robot_id == row.pk:
        own = ("pose", "velocity", "mode", "safety", "errors")
        fields |= {name: report.get(name) for name in own}
        fields["reason"] = row.presence.turnaround_reason
    return fields


def _fixed(request: HttpRequest, row: Robot) -> dict[str, Any]:
    """Return the fields of a robot's kind and place, and its addresses."""
    plan, factsheet = row.floor_plan, row.presence.factsheet or {}
    address = request.build_absolute_uri
    return {
        "series": factsheet.get("series", ""),
        "capabilities": list(factsheet.get("capabilities", ())),
        "places": [
            {name: place.get(name) for name in ("name", "x", "y")}
            for place in (plan.plan.get("places", ()) if plan else ())
        ],
        "floorPlan": address(reverse("floor_plan", args=[plan.name])) if plan else None,
        "page": address(reverse("drive", args=[row.name])),
    }


def _state(row: Robot, report: dict[str, Any], *, busy: bool, online: bool) -> str:
    if not online:
        return "offline"
    if standstill_of(report):
        return "stopped"
    returns = row.can_go_home and row.presence.turnaround != Robot.Turnaround.READY
    return "busy" if busy or (returns and not was_stopped(row)) else "available"


# --- acting ---------------------------------------------------------------------------------------


def _for_own_key(
    view: Callable[[HttpRequest, ApiKey, str], Awaitable[JsonResponse]],
) -> Callable[..., Awaitable[JsonResponse]]:
    """Require the robot's own key and a known action, within the rate limit of the key."""

    @functools.wraps(view)
    async def checked(request: HttpRequest, robot: str) -> JsonResponse:
        key = await database_sync_to_async(_acting_key)(request, robot)
        if isinstance(key, JsonResponse):
            return key
        kind = _kind(request)
        if kind is None:
            kinds = ", ".join(get_args(ActionKind))
            return problem(400, "unknown_action", f"Send a JSON object with “type”: {kinds}.")
        return await view(request, key, kind)

    return checked


def _acting_key(request: HttpRequest, robot: str) -> ApiKey | JsonResponse:
    """Return the key of a request that acts on a robot, after counting the action. Queries the
    database and the cache: not for the event loop.
    """
    key = _key_or_problem(request)
    if isinstance(key, JsonResponse):
        return key
    if key is None or key.robot.name != robot:
        return problem(403, "not_allowed", "To act on a robot, send a key of that robot.")
    name, now = str(key.pk), time.time()
    return key if ACTED.count(name, now) else too_many(ACTED, name, now, "too_many_actions")


class _Request(msgspec.Struct):
    type: ActionKind


def _kind(request: HttpRequest) -> ActionKind | None:
    if len(request.body) > MAX_BODY:
        return None
    try:
        return msgspec.json.decode(request.body, type=_Request).type
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


@csrf_exempt  # cookies are not used here
@never_cache
@require_POST
@_for_own_key
async def act(_request: HttpRequest, key: ApiKey, kind: str) -> JsonResponse:
    """Stop a robot, or send it to its station; 202: the request was sent, and the robot's state
    shows the result.
    """
    now = timezone.now()
    done = await (_send_home(key, now) if kind == "dock" else _stop(key, kind, now))
    await database_sync_to_async(system_log.log)(
        "api_action", robot=key.robot, at=now, type=kind, key=key.label, answer=done.status_code
    )
    return done


async def _stop(key: ApiKey, kind: str, now: datetime.datetime) -> JsonResponse:
    bridge = mqtt_bridge.current()
    if not await bridge.wait_connected(BROKER_PATIENCE_SECONDS):
        return problem(503, "broker_away", "The robot cannot be reached now. Try again later.")
    named = {
        "action_id": f"api-{uuid.uuid4().hex}",
        "stamp": now.timestamp(),
        "role": "owner",
        "user": key.label[:60],
    }
    action = EStop(**named, detail="api") if kind == "estop" else Stop(**named)
    bridge.send_stop(key.robot.name, action)
    return JsonResponse({"apiVersion": VERSION, "actionId": action.action_id}, status=202)


async def _send_home(key: ApiKey, now: datetime.datetime) -> JsonResponse:
    """Have the session manager send the robot to its dock as after a session, if it is free."""
    if not key.robot.can_go_home:
        return problem(
            409,
            "cannot_go_home",
            "The robot does not dock by itself, or its owner has turned this off.",
        )
    if was_stopped(key.robot):
        return problem(
            409,
            "stopped",
            "Someone stopped the robot. A person at the robot, an operator or a new driver must"
            " release it.",
        )
    if not await database_sync_to_async(_mark_returning)(key.robot, now):
        return problem(
            409, "driven", "A visitor has the robot. It returns to its station when the visit ends."
        )
    return JsonResponse({"apiVersion": VERSION}, status=202)


def _mark_returning(robot: Robot, now: datetime.datetime) -> bool:
    """Mark a free robot as returning, in one statement; True also if it is already returning."""
    free = RobotPresence.objects.filter(robot=robot).exclude(
        robot__in=Session.objects.filter(robot=robot, state__in=LIVE).values("robot_id")
    )
    marked = free.filter(turnaround=Robot.Turnaround.READY).update(
        turnaround=Robot.Turnaround.RETURNING, turnaround_reason="dock", turnaround_at=now
    )
    return bool(marked) or free.exclude(turnaround=Robot.Turnaround.READY).exists()
