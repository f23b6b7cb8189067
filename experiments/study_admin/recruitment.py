"""The page of a study about its recruitment site: the link to enter there, the codes and return
addresses, who is to be paid, appointments, and keys for programs. Mixed into the studies'
administration.
"""

from typing import Any

from django import forms
from django.contrib import messages
from django.db import IntegrityError, transaction
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.urls import URLPattern, path, reverse
from django.utils import timezone
from django.utils.translation import gettext as _
from django.utils.translation import gettext_lazy
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from accounts import audit
from experiments import publishing
from experiments.builder.labels import ENDING_NAMES
from experiments.models import Appointment, Study, StudyKey
from experiments.participation import completion
from experiments.recruitment import keys, sites
from experiments.recruitment.payments import payment_rows
from experiments.research.study_access import study_for
from robots.files.csv_text import csv_text

MOST_LISTED = 200


class KeyForm(forms.Form):
    """What a key is for."""

    label = forms.CharField(label=gettext_lazy("What the key is for"), max_length=60, min_length=2)


class RecruitmentPages:
    """The recruitment page, and the table of payments."""

    def recruitment_urls(self) -> list[URLPattern]:
        """Return their addresses."""
        guard = self.admin_site.admin_view  # type: ignore[attr-defined]
        return [
            path(
                "<uuid:pk>/recruitment/",
                guard(never_cache(self.recruitment_view)),
                name="experiments_study_recruitment",
            ),
            path(
                "<uuid:pk>/payments.csv",
                guard(never_cache(require_safe(self.payments_view))),
                name="experiments_study_payments",
            ),
        ]

    def recruitment_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Show the page to researchers; a POST makes a key, shown in this answer only, or takes one
        away.
        """
        row = study_for(request, pk, "researcher")
        form, made = KeyForm(), ""
        if request.method == "POST" and "revoke" in request.POST:
            return _revoke(request, row)
        if request.method == "POST":
            form = KeyForm(request.POST)
            made = _made(request, row, form)
            form = form if form.errors else KeyForm()
        definition = row.as_definition()
        address = request.build_absolute_uri(reverse("study", args=[row.slug]))
        site = definition.recruiting.site if definition.recruiting else "any"
        upcoming = Appointment.objects.filter(
            participant__study=row, ends_at__gt=timezone.now()
        ).select_related("participant", "robot")
        api = reverse("api_participants", args=[row.slug])
        return self._page(  # type: ignore[attr-defined]
            request,
            row,
            "recruitment",
            _("Recruitment"),
            site=sites.PROFILES[site].title if site in sites.PROFILES else "",
            link=sites.study_link(definition.recruiting, address),
            endings=_endings(row),
            has_appointments=definition.appointments is not None,
            appointments=upcoming[:MOST_LISTED],
            keys=StudyKey.objects.filter(slug=row.slug).order_by("label"),
            form=form,
            made=made,
            api=request.build_absolute_uri(api),
        )

    def payments_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Answer with the table of payments, which names people by their recruitment ids."""
        row = study_for(request, pk, "researcher")
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


def _made(request: HttpRequest, row: Study, form: KeyForm) -> str:
    if not form.is_valid():
        return ""
    label = form.cleaned_data["label"]
    try:
        with transaction.atomic():
            key = keys.make_key(row.slug, label, request.user, timezone.now())
    except IntegrityError:
        form.add_error("label", _("There is a key of this name. Choose another one."))
        return ""
    publishing.log(row, request.user, f"API key made: {label}.")
    audit.note("study_key_made", actor=request.user, study=row.slug, detail=label)
    return key


def _revoke(request: HttpRequest, row: Study) -> HttpResponse:
    named = StudyKey.objects.filter(slug=row.slug, label=request.POST["revoke"])
    if named.delete()[0]:
        label = request.POST["revoke"]
        publishing.log(row, request.user, f"API key revoked: {label}.")
        audit.note("study_key_revoked", actor=request.user, study=row.slug, detail=label)
        messages.success(request, _("Key revoked. It no longer works."))
    return HttpResponseRedirect(request.path)
