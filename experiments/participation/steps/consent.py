"""The page on which a participant consents, or leaves."""

import datetime

from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.utils.translation import gettext_lazy as _

from experiments.definition.steps.consent import Consent
from experiments.models import ConsentReceipt, Participant
from experiments.participation import progress
from experiments.participation.consent import ConsentForm, agree
from experiments.participation.step_page import StepPage
from experiments.participation.withdrawal.receipt import leave
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
        participant, language = self.participant, self.language(request)
        if request.POST.get("go") == "decline":
            return leave(request, participant, now)
        form = ConsentForm(self.step, language, request.POST)
        if form.is_too_young:
            progress.screen_out(participant, now)
            return False
        if not form.is_valid():
            return self._form(request, form, status=WRONG)
        given = {"guardian": "", "age": None, "sharing": None, **form.cleaned_data}
        del given["agree"]
        agree(participant, self.step, language=language, now=now, **given)
        return True
