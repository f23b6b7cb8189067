"""The steps of a study, all at one address, which shows the participant's current step on any
device.

A page sends back the place at which it was shown. An answer to another place than the current one
changes nothing and leads to the current step, so that a reload, the back button or a second tab
does nothing twice.
"""

import datetime
import functools
from collections.abc import Callable
from typing import Any

from django.http import Http404, HttpRequest, HttpResponseBase, HttpResponseRedirect
from django.shortcuts import redirect, render
from django.urls import reverse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods, require_safe

from experiments.definition.course import CourseError
from experiments.definition.step import AskingStep
from experiments.models import Participant
from experiments.participation import (
    advance,
    completion,
    drive_config,
    journey,
    progress,
    questions,
)
from experiments.participation.drive_status import robot_for, status_at
from experiments.participation.step_page import render_in_frame, return_button, show_end, to_step
from experiments.participation.steps import page_of
from experiments.participation.views import BAD
from experiments.recruitment import screening
from experiments.resources import sites
from robots.access import may_drive
from sessions.views import page_config

Status = Participant.Status


def of_participant(view: Callable[[HttpRequest, Participant], HttpResponseBase]) -> Any:
    """Call a view with the participant of the study; lead others to the study's front page."""

    @never_cache
    @functools.wraps(view)
    def found(request: HttpRequest, slug: str) -> HttpResponseBase:
        study = progress.study_for(request.user, slug)
        if study is None:
            raise Http404
        participant = progress.found(study, request.user)
        return redirect("study", slug) if participant is None else view(request, participant)

    return found


@require_http_methods(["GET", "HEAD", "POST"])
@of_participant
def step(request: HttpRequest, participant: Participant) -> HttpResponseBase:
    return _take(request, participant) if request.method == "POST" else _show(request, participant)


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
        operator = questions.operator_text(participant, request.LANGUAGE_CODE)
        more = {"operator": operator, **return_button(participant)}
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
        if isinstance(step, AskingStep) and screening.is_screened_out(participant, step, now):
            progress.screen_out(participant, now)
        elif not advance.go_on(participant, progress.place(participant), now):
            return


@require_safe
@of_participant
def go_back(_request: HttpRequest, participant: Participant) -> HttpResponseBase:
    address = completion.return_address(participant)
    return HttpResponseRedirect(address) if address else to_step(participant)


@require_safe
@of_participant
def drive(request: HttpRequest, participant: Participant) -> HttpResponseBase:
    study, definition, now = participant.study, participant.study.as_definition(), timezone.now()
    drive_step = definition.drive(participant.step)
    if participant.status != Status.ACTIVE or drive_step is None:
        return to_step(participant)
    robot, conditions = robot_for(participant, now)
    here = progress.place(participant)
    state = status_at(participant, here).state
    may_begin = progress.may_begin_drive(participant, now)
    if robot is None or state == "moved" or not (may_begin or state == "living"):
        return to_step(participant)
    trouble = functools.partial(render_in_frame, request, participant, "experiments/trouble.html")
    if not may_drive(request.user, robot):
        return trouble({"trouble": "robot"})
    try:
        plan, step_url = sites()[conditions[0].site], reverse("study_step", args=[study.slug])
        about = {"language": participant.language, "step_url": step_url}
        guide = drive_config.guide(definition, drive_step, conditions, plan, **about)
    except (CourseError, KeyError):
        return trouble({"trouble": "course"})
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
