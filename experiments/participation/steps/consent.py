"""The page on which somebody agrees to take part, or leaves."""

import datetime
from typing import Any

from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.utils.translation import gettext_lazy as _

from experiments.definition.steps.consent import Consent
from experiments.models import ConsentReceipt, Participant
from experiments.participation import consent, progress
from experiments.participation.forms import ConsentForm
from experiments.participation.step_page import StepPage
from experiments.participation.withdrawal.views import leave
from surveys.documents import spoken

WRONG = 422


class ConsentStepPage(StepPage):
    label = _("Consent")
    blank = {"text": {}}

    @classmethod
    def is_done_for_good(cls, participant: Participant, step: Consent) -> bool:
        agreed = ConsentReceipt.objects.filter(participant=participant, step=step.key)
        return bool(agreed.filter(version=step.version).exists())

    def is_done(self) -> bool:
        return self.is_done_for_good(self.participant, self.step)

    def show(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        return self._form(request, ConsentForm(self.step, self.language(request)))

    def _form(self, request: HttpRequest, form: ConsentForm, *, status: int = 200) -> HttpResponse:
        more = {"text": spoken(self.step.text, self.language(request)), "form": form}
        return self.render(request, "experiments/consent.html", more, status=status)

    def take(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase | bool:
        participant, asked = self.participant, self.step
        if request.POST.get("go") == "decline":
            return leave(request, participant, now)
        form = ConsentForm(asked, self.language(request), request.POST)
        if not form.is_valid() and not form.is_too_young:
            return self._form(request, form, status=WRONG)
        if form.is_too_young:
            progress.screen_out(participant, now)
            return False
        given = form.cleaned_data
        consent.agree(
            participant,
            asked,
            language=self.language(request),
            age=given.get("age"),
            guardian=_guardian(asked, given),
            sharing=given.get("sharing"),
            now=now,
        )
        return True


def _guardian(asked: Consent, given: dict[str, Any]) -> str:
    is_minor = (
        asked.minimum_age > 0 and given.get("age") is not None and given["age"] < asked.minimum_age
    )
    return given.get("guardian", "") if is_minor else ""
