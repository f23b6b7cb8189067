"""The page for booking a drive, and the page that stops the e-mails about it."""

import datetime
from collections import defaultdict
from zoneinfo import ZoneInfo

from django import forms
from django.contrib import messages
from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.utils import timezone
from django.utils.translation import gettext as _, gettext_lazy
from django.views.decorators.cache import never_cache
from django.views.decorators.csrf import csrf_exempt
from django.views.decorators.http import require_http_methods

from accounts.attempts import Attempts
from accounts.rate_limits import limited
from experiments.definition.recruitment.recruiting import Appointments
from experiments.models import Appointment, Participant
from experiments.participation import progress
from experiments.participation.drive_status import conditions_on_robot, robots_of
from experiments.participation.step_page import render_in_frame, to_step
from experiments.recruitment import appointments, reminders

BOOKINGS = Attempts("appointments", limit=20)
WRONG = 422


class AddressForm(forms.Form):
    email = forms.EmailField(
        label=gettext_lazy("E-mail address for a reminder"),
        required=False,
        max_length=254,
        widget=forms.EmailInput(attrs={"autocomplete": "email"}),
        help_text=gettext_lazy(
            "Used only for e-mails about your appointments in this study, then deleted."
        ),
    )


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
@limited(BOOKINGS)
def appointment(request: HttpRequest, slug: str) -> HttpResponseBase:
    study = progress.study_for(request.user, slug)
    participant = progress.found(study, request.user) if study is not None else None
    if participant is None:
        return redirect("study", slug)
    asked = participant.study.as_definition().appointments
    if asked is None or participant.status != Participant.Status.ACTIVE:
        return to_step(participant)
    if request.method != "POST":
        return _page(request, participant, asked, AddressForm())
    if "cancel" in request.POST:
        Appointment.objects.filter(participant=participant, visit=participant.visit).delete()
        messages.success(request, _("Your appointment was cancelled."))
        return to_step(participant)
    form = AddressForm(request.POST)
    if form.is_valid():
        if _is_booked(request, participant, form.cleaned_data["email"]):
            return to_step(participant)
        form.add_error(None, _("This time is no longer free. Choose another one."))
    return _page(request, participant, asked, form)


def _is_booked(request: HttpRequest, participant: Participant, email: str) -> bool:
    try:
        starts_at = datetime.datetime.fromisoformat(request.POST.get("at", ""))
    except ValueError:
        return False
    robots = robots_of(conditions_on_robot(participant))
    made = appointments.book(participant, robots, starts_at, timezone.now())
    if made is not None and email:
        reminders.keep_address(participant, email, request.build_absolute_uri("/"))
    return made is not None


def _page(
    request: HttpRequest, participant: Participant, asked: Appointments, form: AddressForm
) -> HttpResponse:
    study, zone = participant.study, ZoneInfo(participant.study.time_zone)
    robots = robots_of(conditions_on_robot(participant))
    days: dict[datetime.date, list[tuple[str, datetime.datetime]]] = defaultdict(list)
    for slot in appointments.free(study, asked, robots, timezone.now()):
        at = slot.starts_at.astimezone(zone)
        # naive, so that no template converts it to another zone
        days[at.date()].append((at.isoformat(), at.replace(tzinfo=None)))
    own, wanted = appointments.current(participant), request.GET.get("day", "")
    day = next((one for one in days if one.isoformat() == wanted), next(iter(days), None))
    more = {
        "days": [(one, len(times), one == day) for one, times in days.items()],
        "times": days[day] if day is not None else [],
        "own": own.starts_at.astimezone(zone).replace(tzinfo=None) if own is not None else None,
        "minutes": asked.minutes,
        "form": form,
    }
    template, status = "experiments/appointment.html", WRONG if form.errors else 200
    return render_in_frame(request, participant, template, more, status=status)


@csrf_exempt  # mail programs send it with one click, and the token is in the address
@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
@limited(BOOKINGS)
def stop_reminders(request: HttpRequest, token: str) -> HttpResponse:
    """Ask whether the e-mails should stop; a POST stops them and deletes the address."""
    is_done = request.method == "POST"
    if is_done:
        reminders.stop(token)
    return render(request, "experiments/reminders_stop.html", {"is_done": is_done})
