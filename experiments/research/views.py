"""Pages for researchers: the live view of a study, and the replay of a session."""

import uuid

import msgspec
from django.http import Http404, HttpRequest, HttpResponse, JsonResponse
from django.shortcuts import get_object_or_404, render
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import gettext as _
from django.views.decorators.cache import never_cache
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_POST, require_safe

from accounts import audit
from accounts.attempts import Attempts
from accounts.rate_limits import limited
from experiments.access import SEES_SESSIONS, for_role, may, session_for
from experiments.models import Drive, Study
from experiments.participation.robot_eligibility import may_use
from experiments.research import interventions, live
from experiments.research.replay import photos_of, player_config, replay
from experiments.research.study_access import viewer_page
from robots.access import may_observe, may_operate
from robots.plans.floorplans import plan_content
from sessions.models import Session

LIVE, ACTS = Attempts("live", limit=240), Attempts("live-act", limit=60)


@viewer_page
def live_page(request: HttpRequest, slug: str) -> HttpResponse:
    versions = list(Study.objects.filter(slug=slug).order_by("-version"))
    if not versions:
        raise Http404
    acts, robots = may(request.user, slug, "researcher"), live.robots_of(slug)
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
        "courses": live.courses_of(slug, robots),
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
    return JsonResponse(live.now_in(slug, timezone.now()))


@require_POST
@limited(ACTS, json=True)
@for_role("researcher")
def live_act(request: HttpRequest, slug: str) -> JsonResponse:
    """Do what a researcher asks: `act` is message, end, hold or release, on a `session` or `robot`,
    with a `text`.
    """
    act, text = request.POST.get("act", ""), request.POST.get("text", "").strip()
    if act not in {"message", "end", "hold", "release"}:
        problem = _("Unknown action.")
    elif not text and act != "release":
        problem = _("Enter a message or reason.")
    elif act in {"hold", "release"}:
        problem = _act_on_robot(request, slug, act, text)
    else:
        problem = _act_on_session(request, slug, act, text)
    return JsonResponse({"problem": problem}, status=409 if problem else 200)


def _act_on_robot(request: HttpRequest, slug: str, act: str, text: str) -> str:
    """Pause or resume a robot's queue; return a problem, or "". Http404 when there is no such robot
    for this user.
    """
    name, user = request.POST.get("robot"), request.user
    robot = next((robot for robot in live.robots_of(slug) if robot.name == name), None)
    if robot is None or not (may_operate(user, robot) or may_use(slug, robot)):
        raise Http404
    if act == "hold":
        interventions.hold(robot, text, user, timezone.now())
    elif not interventions.release(robot, user, timezone.now()):
        return _("Visits have already resumed.")
    return ""


def _act_on_session(request: HttpRequest, slug: str, act: str, text: str) -> str:
    """End a session, or send a message to its page; return a problem, or "". Http404 when there is
    none.
    """
    try:
        key = uuid.UUID(request.POST.get("session", ""))
    except ValueError as error:
        raise Http404 from error
    drives = Drive.objects.select_related("session")
    session = get_object_or_404(drives, session=key, participant__study__slug=slug).session
    given = (session, text, request.user, timezone.now())
    is_over = session.state == Session.State.ENDED
    if is_over or (act == "end" and not interventions.end_session(*given)):
        return _("The session has already ended.")
    if act == "message" and not interventions.send_message(*given):
        return _("The message could not be sent. Try again.")
    return ""


@never_cache
@require_safe
def replay_page(request: HttpRequest, session: uuid.UUID) -> HttpResponse:
    row, drive, photos = session_for(request.user, session)
    user, person = request.user, row.visitor_id
    slug, condition = "", ""
    if drive is not None:
        study = drive.participant.study
        slug, condition = study.slug, live.condition_title(study.as_definition(), drive.condition)
    audit.note("session_opened", actor=user, person=person, study=slug, thing=row)
    begin = (row.granted_at or row.queued_at).timestamp()
    shown = [
        {"t": at, "url": reverse("replay_photo", args=[row.pk, photo.pk])}
        for at, photo in (photos_of(row, begin) if photos else ())
    ]
    context = {
        "session": row,
        "drive": drive,
        "who": drive.participant.code if drive else row.visitor.shown_name,
        "admin": user.is_staff and user.has_perm(SEES_SESSIONS),
        "outcome": _outcome(row, drive),
        "condition": condition,
        "config": player_config(row, reverse("replay_data", args=[row.pk]), shown),
    }
    return render(request, "experiments/research/replay.html", context)


def _outcome(session: Session, drive: Drive | None) -> str:
    outcome = (drive.outcome if drive is not None else "") or session.outcome
    return str(dict(Session.Outcome.choices).get(outcome) or session.get_state_display())


@never_cache
@require_safe
@gzip_page
def replay_data(request: HttpRequest, session: uuid.UUID) -> HttpResponse:
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
