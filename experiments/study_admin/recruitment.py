"""The recruitment page: links, codes, return addresses, payments, appointments, API keys."""

from typing import Any

from django import forms
from django.db import IntegrityError, transaction
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import gettext as _, gettext_lazy
from django.views.decorators.http import require_safe

from accounts import audit
from experiments.builder.labels import ENDING_NAMES
from experiments.builder.study_page import StudyPages, study_view
from experiments.models import Appointment, Study, StudyKey
from experiments.participation import completion
from experiments.recruitment import sites
from experiments.recruitment.api import make_key
from experiments.recruitment.payments import payment_rows
from experiments.research.study_access import note_change
from robots.files.csv_text import csv_text

MOST_LISTED = 200


class KeyForm(forms.Form):
    label = forms.CharField(label=gettext_lazy("What the key is for"), max_length=60, min_length=2)


class RecruitmentPages(StudyPages):
    @study_view("recruitment/", "recruitment", "researcher")
    def recruitment_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        """Show the page; a POST makes a key, which is shown in this answer only, or revokes one."""
        if "revoke" in request.POST:
            _revoke(request, row, request.POST["revoke"])
            return HttpResponseRedirect(request.path)
        form = KeyForm(request.POST if request.method == "POST" else None)
        made = _made_key(request, row, form)
        definition = row.as_definition()
        address = request.build_absolute_uri(reverse("study", args=[row.slug]))
        site = definition.recruiting.site if definition.recruiting else "any"
        booked = Appointment.objects.filter(participant__study=row, ends_at__gt=timezone.now())
        upcoming = booked.select_related("participant", "robot")
        api = reverse("api_participants", args=[row.slug])
        context = {
            "sharing_tab": "recruitment",
            "site": sites.PROFILES[site].title if site in sites.PROFILES else "",
            "link": sites.study_link(definition.recruiting, address),
            "endings": _endings(row),
            "has_appointments": definition.appointments is not None,
            "appointments": upcoming[:MOST_LISTED],
            "keys": StudyKey.objects.filter(slug=row.slug).order_by("label"),
            "form": KeyForm() if made else form,
            "made": made,
            "api": request.build_absolute_uri(api),
        }
        title = _("Recruitment and payments")
        return self.study_page(request, row, "recruitment", title, context, tab="sharing")

    @study_view("payments.csv", "payments", "researcher", require_safe)
    def payments_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        audit.note("payments_exported", actor=request.user, study=row.slug)
        name = f"{row.slug}-payments.csv"
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        return HttpResponse(csv_text(payment_rows(row)), content_type="text/csv", headers=headers)


def _endings(row: Study) -> list[tuple[Any, str, str]]:
    """Return the name, the code and the return address of each ending, with a made-up id."""
    recruiting = row.as_definition().recruiting
    site = recruiting.site if recruiting is not None else "any"
    profile = sites.PROFILES.get(site, sites.PROFILES["prolific"])
    parameter = (recruiting and recruiting.id_parameter) or profile.id_parameter
    example = {parameter: "ID", profile.session_parameter: "SUBMISSION"}
    return [
        (ENDING_NAMES[ending], code, sites.return_address(recruiting, example, ending, code))
        for ending, code in completion.codes(row).items()
    ]


def _made_key(request: HttpRequest, row: Study, form: KeyForm) -> str:
    if not form.is_valid():
        return ""
    label = form.cleaned_data["label"]
    try:
        with transaction.atomic():
            key = make_key(row.slug, label, request.user, timezone.now())
    except IntegrityError:
        form.add_error("label", _("There is a key of this name. Choose another one."))
        return ""
    note_change(request, row, f"API key made: {label}.", event="study_key_made", detail=label)
    return key


def _revoke(request: HttpRequest, row: Study, label: str) -> None:
    if StudyKey.objects.filter(slug=row.slug, label=label).delete()[0]:
        entry, text = f"API key revoked: {label}.", _("Key revoked. It no longer works.")
        note_change(request, row, entry, text, event="study_key_revoked", detail=label)
