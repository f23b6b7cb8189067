"""Consent: its form, and its receipts with the text as it was shown, by whom and when."""

import datetime
import hashlib
from typing import Any

from django import forms
from django.db import IntegrityError, transaction
from django.utils.translation import gettext_lazy as _

from accounts.forms import single_line
from experiments.definition.steps.consent import Consent
from experiments.models import ConsentReceipt, Participant
from surveys.documents import spoken

MAX_AGE = 120


class ConsentForm(forms.Form):
    age = forms.IntegerField(
        label=_("Your age in years"),
        min_value=1,
        max_value=MAX_AGE,
        widget=forms.NumberInput(attrs={"inputmode": "numeric"}),
    )
    guardian = forms.CharField(
        label=_("Name of the parent or guardian who also agrees"),
        max_length=120,
        error_messages={
            "required": _("At your age, a parent or guardian must agree too. Enter their name.")
        },
        widget=forms.TextInput(attrs={"autocomplete": "off"}),
    )
    agree = forms.BooleanField(label=_("I have read this and want to take part."))
    sharing = forms.BooleanField(required=False)

    def __init__(self, step: Consent, language: str, data: Any = None) -> None:
        super().__init__(data)
        is_minor = self._age() < step.minimum_age
        self.is_too_young = is_minor and step.minors == "refused"
        self.fields["sharing"].label = spoken(step.sharing, language) if step.sharing else ""
        if step.minors == "refused":
            hint = _("You must be at least %(age)d to take part.") % {"age": step.minimum_age}
            self.fields["age"].help_text = hint
        if not step.minimum_age:
            del self.fields["age"]
        if not is_minor or step.minors == "refused":
            del self.fields["guardian"]
        if not self.fields["sharing"].label:
            del self.fields["sharing"]

    def _age(self) -> int:
        """Return the entered age; without a valid one, an age at which no rule applies."""
        try:
            return int(self.fields["age"].clean(self.data.get("age")))
        except forms.ValidationError:
            return MAX_AGE

    def clean_guardian(self) -> str:
        return single_line(self.cleaned_data["guardian"])


def agree(
    participant: Participant,
    step: Consent,
    *,
    language: str,
    age: int | None = None,
    guardian: str = "",
    sharing: bool | None = None,
    now: datetime.datetime,
) -> ConsentReceipt:
    """Return the receipt of a participant's consent, made at the first call, with the texts as they
    were shown then; `sharing` is None where the step did not ask.
    """
    text, key = spoken(step.text, language), {"step": step.key, "version": step.version}
    fields = {
        "language": language,
        "text": text,
        "text_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "guardian": guardian[:120],
        "sharing": sharing,
        "sharing_text": spoken(step.sharing, language) if sharing is not None else "",
        "agreed_at": now,
    }
    try:
        with transaction.atomic():
            receipt = ConsentReceipt.objects.create(participant=participant, **key, **fields)
    except IntegrityError:
        return ConsentReceipt.objects.get(participant=participant, **key)
    Participant.objects.filter(pk=participant.pk).update(age=age, language=language)
    participant.age, participant.language = age, language
    return receipt


def take_back_sharing(participant: Participant) -> bool:
    """Leave a participant out of later public datasets; tell whether they were to be in them."""
    return bool(participant.consents.filter(sharing=True).update(sharing=False))


def as_text(receipt: ConsentReceipt) -> str:
    study = receipt.participant.study
    lines = [
        receipt.text,
        "",
        "--",
        f"{study.title} ({study.slug}, version {study.version})",
        f"participant {receipt.participant.code}",
        f"consent {receipt.step}, version {receipt.version}, {receipt.language}",
        f"agreed {receipt.agreed_at.isoformat(timespec='seconds')}",
        f"sha256 of the text {receipt.text_sha256}",
    ]
    if receipt.guardian:
        lines.insert(-1, f"guardian {receipt.guardian}")
    if receipt.sharing is not None:
        lines[1:1] = ["", f"[{'x' if receipt.sharing else ' '}] {receipt.sharing_text}"]
    return "\n".join(lines) + "\n"
