"""The steps of a study, one page each, all at one address: what is shown is where the participant
stands, on whatever device.

A page sends back the place at which it was shown. An answer to another place than the current one
changes nothing and leads to where the participant is: so a reload, the back button or a second tab
does nothing twice.
"""

import datetime

from django.http import Http404, HttpRequest, HttpResponseBase, HttpResponseRedirect
from django.shortcuts import redirect, render
from django.urls import reverse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods, require_safe

from experiments.definition.course import CourseError
from experiments.definition.step import AskingStep
from experiments.models import Participant, Study
from experiments.participation import advance, completion, drive_config, journey, progress
from experiments.participation.drive_status import driven, robot_for
from experiments.participation.step_page import render_in_frame, show_end, to_step, way_back
from experiments.participation.steps import page_of
from experiments.participation.views import BAD
from experiments.publishing import sites
from experiments.recruitment import appointments, screening
from robots.access import may_drive
from sessions.views import page_config

Status = Participant.Status


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
def step(request: HttpRequest, slug: str) -> HttpResponseBase:
    """Show the step on which whoever asks stands, or take their answer to it."""
    participant = _participant(request, slug)
    if participant is None:
        return redirect("study", slug)
    return _take(request, participant) if request.method == "POST" else _show(request, participant)


def _participant(request: HttpRequest, slug: str) -> Participant | None:
    study = progress.study_for(request.user, slug)
    if study is None:
        raise Http404
    return progress.found(study, request.user)


def _take(request: HttpRequest, participant: Participant) -> HttpResponseBase:
    try:
        here = journey.read(request.POST.get("place", ""), progress.way_of(participant))
    except journey.NoPlaceError:
        return render(request, "experiments/refused.html", {"study": participant.study}, status=BAD)
    if participant.status != Status.ACTIVE or here != progress.place(participant):
        return to_step(participant)
    now = timezone.now()
    answer = page_of(participant, progress.step_of(participant)).take(request, now)
    if isinstance(answer, bool):
        if answer:
            advance.go_on(participant, here, now)
        return to_step(participant)
    return answer


def _show(request: HttpRequest, participant: Participant) -> HttpResponseBase:
    now = timezone.now()
    _catch_up(participant, now)
    if participant.status == Status.SCREENED_OUT:
        more = way_back(participant)
        return render_in_frame(request, participant, "experiments/screened_out.html", more)
    if participant.status == Status.FINISHED:
        return show_end(request, participant, now)
    progress.see(participant, now)
    return page_of(participant, progress.step_of(participant)).show(request, now)


def _catch_up(participant: Participant, now: datetime.datetime) -> None:
    """Go on as far as facts say that steps are done: agreed to, answered, driven. Answers may
    screen a participant out.
    """
    while participant.status == Status.ACTIVE:
        step = progress.step_of(participant)
        if not page_of(participant, step).is_done():
            return
        asked = step.questionnaire if isinstance(step, AskingStep) else ""
        if asked and screening.is_screened_out(participant, asked, now):
            progress.screen_out(participant, now)
        elif not advance.go_on(participant, progress.place(participant), now):
            return


@never_cache
@require_safe
def go_back(request: HttpRequest, slug: str) -> HttpResponseBase:
    """Lead a participant who has ended back to the recruitment site, with the code of how."""
    participant = _participant(request, slug)
    if participant is None:
        return redirect("study", slug)
    address = completion.return_address(participant)
    return HttpResponseRedirect(address) if address else to_step(participant)


@never_cache
@require_safe
def drive(request: HttpRequest, slug: str) -> HttpResponseBase:
    """Show the drive page, with what the study says of it, to a participant who is to drive now."""
    participant, now = _participant(request, slug), timezone.now()
    if participant is None:
        return redirect("study", slug)
    definition = participant.study.as_definition()
    if participant.status != Status.ACTIVE or definition.drive(participant.step) is None:
        return to_step(participant)
    robot, conditions = robot_for(participant, now)
    done = driven(participant, progress.place(participant))
    away = (
        robot is None
        or participant.study.status == Study.Status.CLOSED
        or not progress.is_open(participant.study, now)
        or not appointments.may_drive(participant, now)
    )
    if robot is None or done.standing == "moved" or (away and done.standing != "living"):
        return to_step(participant)
    if not may_drive(request.user, robot):
        return render_in_frame(
            request, participant, "experiments/trouble.html", {"trouble": "robot"}
        )
    try:
        guide = drive_config.config(
            participant,
            conditions,
            sites()[conditions[0].site],
            step_url=reverse("study_step", args=[slug]),
        )
    except (CourseError, KeyError):
        return render_in_frame(
            request, participant, "experiments/trouble.html", {"trouble": "course"}
        )
    ahead = advance.coming(participant, progress.place(participant))
    guide["next"] = drive_config.what_follows([journey.step_at(definition, one) for one in ahead])
    number, total = progress.step_count(participant)
    return render(
        request,
        "sessions/drive.html",
        {
            "robot": robot,
            "config": {**page_config(robot, request.user), "practice": None, "study": guide},
            "study_title": progress.title_of(participant.study, request.LANGUAGE_CODE),
            "number": number,
            "total": total,
            "keeps_place": progress.keeps_place(participant),
        },
    )
