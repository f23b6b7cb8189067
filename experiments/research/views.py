"""Pages for researchers while a study runs and afterwards: the live view, and the replay of a
session.
"""

import uuid
from typing import Any

import msgspec
from django.http import Http404, HttpRequest, HttpResponse, JsonResponse
from django.shortcuts import get_object_or_404, render
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import get_language
from django.utils.translation import gettext as _
from django.views.decorators.cache import never_cache
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_POST, require_safe

from accounts import audit
from accounts.attempts import Attempts
from accounts.rate_limits import limited
from experiments.access import for_role, may, session_for
from experiments.models import Drive, Study
from experiments.participation.robot_eligibility import may_use
from experiments.research import interventions, live
from experiments.research.replay import photos_of, replay
from robots.access import may_observe, may_operate
from robots.floorplans import plan_content
from robots.models import Robot
from sessions.models import Session

BROKER_PATIENCE_SECONDS = 1.0
LIVE, ACTS = Attempts("live", limit=240), Attempts("live-act", limit=60)

# --- live -----------------------------------------------------------------------------------------


@never_cache
@require_safe
@for_role("viewer")
def live_page(request: HttpRequest, slug: str) -> HttpResponse:
    """Show who is where in a study, and keep it fresh."""
    versions = list(Study.objects.filter(slug=slug).order_by("-version"))
    if not versions:
        raise Http404
    acts, robots = may(request.user, slug, "researcher"), live.robots_of(slug)
    language = get_language() or "en"
    config = {
        "data": reverse("study_live_data", args=[slug]),
        "act": reverse("study_live_act", args=[slug]) if acts else None,
        "watch": {
            robot.name: reverse("drive", args=[robot.name])
            for robot in robots
            if acts and may_observe(request.user, robot)
        },
        "replay": reverse("replay", args=[uuid.UUID(int=0)]),
        "record": reverse("replay_data", args=[uuid.UUID(int=0)]),
        "version": live.current_version(versions).version,
        "courses": live.courses_of(slug, robots, language),
        "sites": {
            robot.name: plan_content(robot.floor_plan) for robot in robots if robot.floor_plan
        },
    }
    context = {"study": versions[0], "config": config, "acts": acts}
    return render(request, "experiments/research/live.html", context)


@never_cache
@require_safe
@limited(LIVE, reading=True, json=True)
@for_role("viewer")
def live_data(_request: HttpRequest, slug: str) -> JsonResponse:
    return JsonResponse(live.now_in(slug, get_language() or "en", timezone.now()))


@require_POST
@limited(ACTS, json=True)
def live_act(request: HttpRequest, slug: str) -> JsonResponse:
    """Do what a researcher asks: `act` is message, end, hold or release, on a `session` or `robot`,
    with a `text`.
    """
    verdict = _act(request, slug)
    return JsonResponse({"problem": verdict}, status=409 if verdict else 200)


def _act(request: HttpRequest, slug: str) -> str:
    """Carry out an act; return what is wrong.

    Raises:
        Http404: there is no such study, session or robot for whoever asks.
    """
    if not may(request.user, slug, "researcher"):
        raise Http404
    act, text = request.POST.get("act", ""), request.POST.get("text", "").strip()
    if act not in {"message", "end", "hold", "release"}:
        return _("Unknown action.")
    if not text and act != "release":
        return _("Enter a message or reason.")
    if act in {"hold", "release"}:
        return _hold(request, slug, act, text)
    return _on_session(request, slug, act, text)


def _hold(request: HttpRequest, slug: str, act: str, text: str) -> str:
    robot: Robot | None = next(
        (robot for robot in live.robots_of(slug) if robot.name == request.POST.get("robot")), None
    )
    if robot is None or not (may_operate(request.user, robot) or may_use(slug, robot)):
        raise Http404
    if act == "hold":
        interventions.hold(robot, text, request.user, timezone.now())
        return ""
    return (
        ""
        if interventions.release(robot, request.user, timezone.now())
        else _("Visits have already resumed.")
    )


def _on_session(request: HttpRequest, slug: str, act: str, text: str) -> str:
    try:
        key = uuid.UUID(request.POST.get("session", ""))
    except ValueError as error:
        raise Http404 from error
    drive = get_object_or_404(
        Drive.objects.select_related("session"), session=key, participant__study__slug=slug
    )
    session, now = drive.session, timezone.now()
    if session.state == Session.State.ENDED:
        return _("The session has already ended.")
    if act == "end":
        return (
            ""
            if interventions.end_session(session, text, request.user, now)
            else _("The session has already ended.")
        )
    return (
        ""
        if interventions.send_message(session, text, request.user, now)
        else _("The message could not be sent. Try again.")
    )


# --- replay ---------------------------------------------------------------------------------------


@never_cache
@require_safe
def replay_page(request: HttpRequest, session: uuid.UUID) -> HttpResponse:
    row, drive, photos = session_for(request.user, session)
    audit.note(
        "session_opened",
        actor=request.user,
        person=row.visitor_id,
        study=drive.participant.study.slug if drive else "",
        thing=row,
    )
    begin = (row.granted_at or row.queued_at).timestamp()
    shown = (
        [
            {"t": at, "url": reverse("replay_photo", args=[row.pk, photo.pk])}
            for at, photo in photos_of(row, begin)
        ]
        if photos
        else []
    )
    context = {
        "session": row,
        "drive": drive,
        "who": drive.participant.code if drive else row.visitor.shown_name,
        "admin": request.user.is_staff
        and request.user.has_perm("telepresence_sessions.view_session"),
        "outcome": _outcome(row, drive),
        "condition": _condition(drive) if drive is not None else "",
        "config": _config(row, shown),
    }
    return render(request, "experiments/research/replay.html", context)


def _outcome(session: Session, drive: Drive | None) -> str:
    """Return how the task ended, or the session, or where it stands."""
    outcome = (drive.outcome if drive is not None else "") or session.outcome
    return str(
        Session.Outcome(outcome).label
        if outcome in Session.Outcome.values
        else session.get_state_display()
    )


def _condition(drive: Drive) -> str:
    return live.condition_title(
        drive.participant.study.as_definition(), drive.condition, get_language() or "en"
    )


def _config(session: Session, photos: list[dict[str, Any]]) -> dict[str, Any]:
    robot = session.robot
    return {
        "data": reverse("replay_data", args=[session.pk]),
        "site": plan_content(robot.floor_plan) if robot.floor_plan else None,
        "footprint": (robot.presence.factsheet or {}).get("footprint", []),
        "photos": photos,
    }


@never_cache
@require_safe
@gzip_page
def replay_data(request: HttpRequest, session: uuid.UUID) -> HttpResponse:
    """Answer with the record of a session, compact."""
    row, drive, _photos = session_for(request.user, session)
    return HttpResponse(msgspec.json.encode(replay(row, drive)), content_type="application/json")


@require_safe
def replay_photo(request: HttpRequest, session: uuid.UUID, photo: uuid.UUID) -> HttpResponse:
    row, _drive, photos = session_for(request.user, session)
    found = row.snapshots.filter(pk=photo).first() if photos else None
    if found is None:
        raise Http404
    audit.note("photo_opened", actor=request.user, person=row.visitor_id, thing=found)
    headers = {"Cache-Control": "private, max-age=3600", "X-Content-Type-Options": "nosniff"}
    return HttpResponse(bytes(found.jpeg), content_type="image/jpeg", headers=headers)
