"""Forms of a participant: the consent. Questions belong to questionnaires."""

from typing import Any

from django import forms
from django.utils.translation import gettext_lazy as _

from accounts.forms import single_line
from experiments.definition.steps.consent import Consent
from experiments.participation.consent import may_agree
from surveys.documents import spoken

OLDEST = 120


class EntryCodeForm(forms.Form):
    """The code that somebody without an account was shown when they began."""

    code = forms.CharField(
        label=_("Your code"),
        max_length=40,
        widget=forms.TextInput(
            attrs={"autocomplete": "off", "autocapitalize": "characters", "spellcheck": "false"}
        ),
    )


class ConsentForm(forms.Form):
    """The age, where the study asks for it, a guardian where that is needed, the agreement itself,
    and apart from it that to publishing.
    """

    age = forms.IntegerField(
        label=_("Your age in years"),
        min_value=1,
        max_value=OLDEST,
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
        self.step = step
        self.is_too_young = False
        self.fields["sharing"].label = spoken(step.sharing, language) if step.sharing else ""
        if not self.fields["sharing"].label:
            del self.fields["sharing"]
        if not step.minimum_age:
            del self.fields["age"]
        else:
            self.fields["age"].help_text = self._age_hint()
        # asked of minors alone, once their age is known
        if step.minors == "refused" or not self._is_minor(data):
            del self.fields["guardian"]

    def _is_minor(self, data: Any) -> bool:
        if data is None or "age" not in self.fields:
            return False
        try:
            age = self.fields["age"].clean(data.get("age"))
        except forms.ValidationError:
            return False
        return bool(age < self.step.minimum_age)

    def _age_hint(self) -> str:
        return (
            _("You must be at least %(age)d to take part.") % {"age": self.step.minimum_age}
            if self.step.minors == "refused"
            else ""
        )

    def clean_guardian(self) -> str:
        return single_line(self.cleaned_data["guardian"])

    def clean(self) -> dict[str, Any]:
        """Apply the study's rule for minors; who is too young is no error, but turned away."""
        cleaned = super().clean() or {}
        if "age" in self.fields and cleaned.get("age") is None:
            return cleaned
        verdict = may_agree(self.step, cleaned.get("age"), cleaned.get("guardian", ""))
        self.is_too_young = verdict == "too_young"
        return cleaned
