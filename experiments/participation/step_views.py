"""The steps of a study, one page each, all at one address: what is shown is where the participant
stands, on whatever device.

A page sends back the place at which it was shown. An answer to another place than the current one
changes nothing and leads to where the participant is: so a reload, the back button or a second tab
does nothing twice.
"""

import datetime
from typing import Any

from django.conf import settings
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.urls import reverse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods, require_safe

from experiments.definition.course import CourseError
from experiments.definition.opening_hours import opens_on_the_wall
from experiments.definition.publishing import sites
from experiments.definition.schema import (
    AnyStep,
    Consent,
    Debrief,
    Form,
    Instructions,
    Leaf,
    Practice,
    Questionnaire,
    Task,
)
from experiments.models import ConsentReceipt, Participant, Study
from experiments.participation import completion, consent, journey, own_data, progress, questions
from experiments.participation.drive_status import (
    DriveStatus,
    driven,
    last_drive,
    robot_for,
    series_of,
)
from experiments.participation.forms import ConsentForm
from experiments.participation.views import BAD
from experiments.tasks import page
from robots.access import may_drive
from sessions.views import page_config
from surveys.documents import BadDefinitionError, spoken
from surveys.models import Questionnaire as QuestionnaireRow

PICTURES = frozenset(
    path.stem for path in (settings.BASE_DIR / "static" / "img" / "instructions").glob("*.svg")
)
Status = Participant.Status
WRONG = 422


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


# --- answers --------------------------------------------------------------------------------------


def _take(request: HttpRequest, participant: Participant) -> HttpResponseBase:
    try:
        here = journey.read(request.POST.get("place", ""), progress.way_of(participant))
    except journey.NoPlaceError:
        return render(request, "experiments/refused.html", {"study": participant.study}, status=BAD)
    if participant.status != Status.ACTIVE or here != progress.place(participant):
        return _to_step(participant)
    match progress.step_of(participant):
        case Consent() as asked:
            return _take_consent(request, participant, asked)
        case Instructions():
            progress.go_on(participant, here, timezone.now())
        case Practice() | Task() as drive_step if request.POST.get("go") == "without":
            if _may_do_without(participant, drive_step, timezone.now()):
                progress.go_on(participant, here, timezone.now())
    return _to_step(participant)


def _take_consent(
    request: HttpRequest, participant: Participant, asked: Consent
) -> HttpResponseBase:
    here, now = progress.place(participant), timezone.now()
    if request.POST.get("go") == "decline":
        own_data.withdraw(participant, now)
        return render(
            request,
            "experiments/withdrawn.html",
            {"title": progress.title_of(participant.study, request.LANGUAGE_CODE)},
        )
    form = ConsentForm(asked, request.POST)
    if not form.is_valid() and not form.is_too_young:
        return _show_consent(request, participant, asked, form, status=WRONG)
    if form.is_too_young:
        progress.screen_out(participant, now)
    else:
        given = form.cleaned_data
        language = progress.language_of(participant.study.as_definition(), request.LANGUAGE_CODE)
        consent.agree(
            participant,
            asked,
            language=language,
            age=given.get("age"),
            guardian=_guardian(asked, given),
            now=now,
        )
        progress.go_on(participant, here, now)
    return _to_step(participant)


def _guardian(asked: Consent, given: dict[str, Any]) -> str:
    is_minor = (
        asked.minimum_age > 0 and given.get("age") is not None and given["age"] < asked.minimum_age
    )
    return given.get("guardian", "") if is_minor else ""


def _to_step(participant: Participant) -> HttpResponseBase:
    return redirect("study_step", participant.study.slug)


# --- what is shown --------------------------------------------------------------------------------


def _show(request: HttpRequest, participant: Participant) -> HttpResponseBase:
    now = timezone.now()
    _catch_up(participant, now)
    if participant.status == Status.SCREENED_OUT:
        return _render(request, participant, "experiments/screened_out.html", {})
    if participant.status == Status.FINISHED:
        return _show_end(request, participant, now)
    progress.see(participant, now)
    return _show_step(request, participant, progress.step_of(participant), now)


def _show_step(
    request: HttpRequest, participant: Participant, current: AnyStep, now: datetime.datetime
) -> HttpResponseBase:
    match current:
        case Consent():
            return _show_consent(request, participant, current, ConsentForm(current))
        case Form() | Questionnaire():
            return _ask(request, participant, current, now)
        case Instructions():
            return _show_leaf(request, participant, current)
        case Practice() | Task():
            return _show_drive(request, participant, current, now)
    completion.conclude(participant, now)
    return _show_end(request, participant, now)


def _catch_up(participant: Participant, now: datetime.datetime) -> None:
    """Go on as far as facts say that steps are done: agreed to, answered, driven."""
    while participant.status == Status.ACTIVE and _is_done(
        participant, progress.step_of(participant)
    ):
        if not progress.go_on(participant, progress.place(participant), now):
            return


def _is_done(participant: Participant, current: AnyStep) -> bool:
    here = progress.place(participant)
    match current:
        case Consent():
            return ConsentReceipt.objects.filter(
                participant=participant, step=current.key, version=current.version
            ).exists()
        case Form() | Questionnaire():
            return questions.is_answered(participant, here, current)
        case Practice() | Task():
            return driven(participant, here).standing == "exposed"
    return False


def _render(
    request: HttpRequest,
    participant: Participant,
    template: str,
    more: dict[str, Any],
    *,
    status: int = 200,
) -> HttpResponse:
    definition = participant.study.as_definition()
    language = progress.language_of(definition, request.LANGUAGE_CODE)
    here = progress.place(participant)
    number, total = journey.share_done(progress.way_of(participant), here)
    context = {
        "study": participant.study,
        "participant": participant,
        "title": spoken(definition.title, language),
        "language": language,
        "heading": spoken(progress.step_of(participant).title, language),
        "place": here.word,
        "number": number,
        "total": total,
        "is_draft": participant.study.status == Study.Status.DRAFT,
        **more,
    }
    return render(request, template, context, status=status)


def _language(request: HttpRequest, participant: Participant) -> str:
    return progress.language_of(participant.study.as_definition(), request.LANGUAGE_CODE)


def _show_consent(
    request: HttpRequest,
    participant: Participant,
    asked: Consent,
    form: ConsentForm,
    *,
    status: int = 200,
) -> HttpResponse:
    text = consent.text_of(asked, _language(request, participant))
    return _render(
        request,
        participant,
        "experiments/consent.html",
        {"text": text, "form": form},
        status=status,
    )


def _ask(
    request: HttpRequest,
    participant: Participant,
    asking: Form | Questionnaire,
    now: datetime.datetime,
) -> HttpResponseBase:
    here = progress.place(participant)
    last = last_drive(participant, here)
    robot = (last.robot.name, series_of(last.robot)) if last.robot is not None else ()
    return_to = reverse("study_step", args=[participant.study.slug])
    try:
        response = questions.ask(
            participant,
            here,
            asking,
            robot=robot,
            outcome=last.outcome,
            return_to=return_to,
            now=now,
        )
    except (QuestionnaireRow.DoesNotExist, BadDefinitionError):
        return _render(request, participant, "experiments/trouble.html", {"trouble": "questions"})
    return redirect("survey", response.pk)


def _show_leaf(
    request: HttpRequest, participant: Participant, instructions: Instructions
) -> HttpResponseBase:
    leaves = leaves_for(participant, instructions)
    if not leaves:
        progress.go_on(participant, progress.place(participant), timezone.now())
        return _to_step(participant)
    asked = request.GET.get("leaf", "1")
    number = (
        min(max(int(asked), 1), len(leaves))
        if asked.isascii() and asked.isdigit() and len(asked) < len("1000")
        else 1
    )
    leaf = leaves[number - 1]
    more = {
        "text": spoken(leaf.text, _language(request, participant)),
        "picture": f"img/instructions/{leaf.picture}.svg" if leaf.picture in PICTURES else "",
        "leaf": number,
        "leaves": len(leaves),
        "before": number - 1,
        "after": number + 1 if number < len(leaves) else None,
        "may_skip": participant.visit > 1 or participant.round > 0,
    }
    return _render(request, participant, "experiments/instructions.html", more)


def leaves_for(participant: Participant, instructions: Instructions) -> tuple[Leaf, ...]:
    """Return the pages of instructions that are for the robots that a participant may drive."""
    robots = {condition.robot for condition in progress.open_conditions(participant)}
    return tuple(
        leaf for leaf in instructions.leaves if not leaf.robot or robots.intersection(leaf.robot)
    )


def _show_end(
    request: HttpRequest, participant: Participant, now: datetime.datetime
) -> HttpResponse:
    if not participant.completion:
        completion.conclude(participant, now)
    last = progress.step_of(participant)
    language = _language(request, participant)
    text = spoken(last.text, language) if isinstance(last, Debrief) else ""
    more = {
        "text": text,
        "may_come_again": participant.study.status != Study.Status.CLOSED
        and progress.is_open(participant.study, now),
    }
    return _render(request, participant, "experiments/debrief.html", more)


# --- driving --------------------------------------------------------------------------------------


def _show_drive(
    request: HttpRequest,
    participant: Participant,
    drive_step: Practice | Task,
    now: datetime.datetime,
) -> HttpResponseBase:
    study, done = participant.study, driven(participant, progress.place(participant))
    is_full = not progress.has_place(participant) and progress.is_full(
        study, _access(participant), participant.kind
    )
    if is_full and done.standing == "never":
        progress.screen_out(participant, now)
        return _to_step(participant)
    robot, _conditions = robot_for(participant, now)
    more = {
        "driven": done,
        "robot": robot,
        "is_practice": isinstance(drive_step, Practice),
        "minutes": round(drive_step.minutes),
        "is_online": robot is not None and robot.is_online(now),
        "is_closed": study.status == Study.Status.CLOSED,
        "is_full": is_full,
        "opens_at": opens_on_the_wall(study.opening_hours, study.time_zone, now),
        "may_do_without": _may_do_without(participant, drive_step, now),
    }
    return _render(request, participant, "experiments/drive_step.html", more)


def _access(participant: Participant) -> Any:
    return "invitation" if participant.access == "invitation" else "open"


def _may_do_without(
    participant: Participant, drive_step: Practice | Task, now: datetime.datetime
) -> bool:
    """Tell whether somebody may go on without driving: after a drive that never began, or where
    none can begin now.
    """
    done: DriveStatus = driven(participant, progress.place(participant))
    if done.standing == "living":
        return False
    if (
        isinstance(drive_step, Practice)
        or done.standing == "unexposed"
        or participant.study.status == Study.Status.CLOSED
    ):
        return True
    robot, _conditions = robot_for(participant, now)
    return robot is None or not robot.is_online(now)


@never_cache
@require_safe
def drive(request: HttpRequest, slug: str) -> HttpResponseBase:
    """Show the drive page, with what the study says of it, to a participant who is to drive now."""
    participant, now = _participant(request, slug), timezone.now()
    if participant is None:
        return redirect("study", slug)
    if participant.status != Status.ACTIVE or not isinstance(
        progress.step_of(participant), Practice | Task
    ):
        return _to_step(participant)
    robot, conditions = robot_for(participant, now)
    done = driven(participant, progress.place(participant))
    away = (
        robot is None
        or participant.study.status == Study.Status.CLOSED
        or not progress.is_open(participant.study, now)
    )
    if robot is None or done.standing == "exposed" or (away and done.standing != "living"):
        return _to_step(participant)
    if not may_drive(request.user, robot):
        return _render(request, participant, "experiments/trouble.html", {"trouble": "robot"})
    try:
        guide = page.config(
            participant,
            conditions,
            sites()[conditions[0].site],
            step_url=reverse("study_step", args=[slug]),
        )
    except (CourseError, KeyError):
        return _render(request, participant, "experiments/trouble.html", {"trouble": "course"})
    return render(
        request,
        "sessions/drive.html",
        {
            "robot": robot,
            "config": {**page_config(robot, request.user), "practice": None, "study": guide},
        },
    )
