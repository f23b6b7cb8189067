"""The steps of a study, all at one address, which shows the participant's current step on any
device.

A page sends back the place at which it was shown. An answer to another place than the current one
changes nothing and leads to the current step, so that a reload, the back button or a second tab
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
from experiments.models import Participant
from experiments.participation import advance, completion, drive_config, journey, progress
from experiments.participation.drive_status import robot_for, status_at
from experiments.participation.step_page import render_in_frame, return_button, show_end, to_step
from experiments.participation.steps import page_of
from experiments.participation.views import BAD
from experiments.publishing import sites
from experiments.recruitment import screening
from robots.access import may_drive
from sessions.views import page_config

Status = Participant.Status


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
def step(request: HttpRequest, slug: str) -> HttpResponseBase:
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
        here = journey.read(request.POST.get("place", ""), progress.route_of(participant))
    except journey.NoPlaceError:
        return render(request, "experiments/refused.html", {"study": participant.study}, status=BAD)
    if participant.status != Status.ACTIVE or here != progress.place(participant):
        return to_step(participant)
    now = timezone.now()
    answer = page_of(participant, progress.step_of(participant)).take(request, now)
    if isinstance(answer, HttpResponseBase):
        return answer
    if answer:
        advance.go_on(participant, here, now)
    return to_step(participant)


def _show(request: HttpRequest, participant: Participant) -> HttpResponseBase:
    now = timezone.now()
    _catch_up(participant, now)
    if participant.status == Status.SCREENED_OUT:
        more = return_button(participant)
        return render_in_frame(request, participant, "experiments/screened_out.html", more)
    if participant.status == Status.FINISHED:
        return show_end(request, participant, now)
    progress.see(participant, now)
    return page_of(participant, progress.step_of(participant)).show(request, now)


def _catch_up(participant: Participant, now: datetime.datetime) -> None:
    """Pass the steps that are done. Answers may screen a participant out."""
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
    participant = _participant(request, slug)
    if participant is None:
        return redirect("study", slug)
    address = completion.return_address(participant)
    return HttpResponseRedirect(address) if address else to_step(participant)


@never_cache
@require_safe
def drive(request: HttpRequest, slug: str) -> HttpResponseBase:
    participant, now = _participant(request, slug), timezone.now()
    if participant is None:
        return redirect("study", slug)
    study, definition = participant.study, participant.study.as_definition()
    drive_step = definition.drive(participant.step)
    if participant.status != Status.ACTIVE or drive_step is None:
        return to_step(participant)
    robot, conditions = robot_for(participant, now)
    here = progress.place(participant)
    state = status_at(participant, here).state
    may_begin = progress.may_begin_drive(participant, now)
    if robot is None or state == "moved" or not (may_begin or state == "living"):
        return to_step(participant)
    if not may_drive(request.user, robot):
        more = {"trouble": "robot"}
        return render_in_frame(request, participant, "experiments/trouble.html", more)
    try:
        guide = drive_config.guide(
            definition,
            drive_step,
            conditions,
            sites()[conditions[0].site],
            language=participant.language,
            step_url=reverse("study_step", args=[slug]),
        )
    except (CourseError, KeyError):
        more = {"trouble": "course"}
        return render_in_frame(request, participant, "experiments/trouble.html", more)
    ahead = advance.following(participant, here)
    guide["next"] = drive_config.what_follows([journey.step_at(definition, one) for one in ahead])
    number, total = progress.step_count(participant)
    context = {
        "robot": robot,
        "config": {**page_config(robot, request.user), "practice": None, "study": guide},
        "study_title": progress.title_of(study, request.LANGUAGE_CODE),
        "number": number,
        "total": total,
        "keeps_place": progress.keeps_place(participant),
    }
    return render(request, "sessions/drive.html", context)
