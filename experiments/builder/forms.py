"""Forms of the studies' administration."""

import datetime
from functools import partial
from typing import Any

from django import forms
from django.core.validators import validate_email
from django.db.models import Q
from django.utils import timezone
from django.utils.translation import gettext, gettext_lazy as _

from accounts.models import User
from experiments import publishing
from experiments.access import may
from experiments.definition.problems import MAX_BYTES, parse
from experiments.definition.schema import StudyDefinition, to_json
from experiments.models import Study, StudyMember
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError, ChangedMeanwhileError
from surveys.forms import DocumentForm, LanguagesField

MOST_LINKS, MOST_DAYS = 500, 366


NameField = partial(
    forms.SlugField,
    label=_("Name"),
    max_length=40,
    help_text=_("Lower-case letters, digits and hyphens. Used in the address."),
)


class StudyForm(DocumentForm):
    """A study: who may join, and of a draft its whole definition as JSON."""

    reference, limit = "studies", MAX_BYTES

    name = NameField(required=False)
    called = forms.CharField(label=_("Title"), required=False, max_length=200)
    spoken = LanguagesField(required=False, initial=["en"])

    class Meta:
        model = Study
        fields = ("entry", "exclusive")

    user: Any = None  # set by the administration on a subclass

    def clean(self) -> dict[str, Any]:
        """Store the definition here, so that a conflict is an error of the form."""
        cleaned = super().clean() or self.cleaned_data
        document = self.sent()
        if self.errors or not (document or self.is_new):
            return cleaned
        try:
            self.stored = self._take(parse(document)) if document else self._begin(cleaned)
        except BadDefinitionError as error:
            raise forms.ValidationError(sentences(error.problems)) from error
        except ChangedMeanwhileError as error:
            words = gettext(
                "Not saved: someone else changed or published this study at the same time. Try "
                "again."
            )
            raise forms.ValidationError(words) from error
        return cleaned

    def _begin(self, cleaned: dict[str, Any]) -> Study:
        name = cleaned.get("name")
        if not name:
            words = gettext(
                "Choose a file, paste its text, or enter a name to start an empty study."
            )
            raise BadDefinitionError([words])
        title, languages = cleaned.get("called") or name, cleaned.get("spoken") or ["en"]
        return publishing.begin_empty(name, title, languages, timezone.now())

    def _take(self, definition: StudyDefinition) -> Study:
        is_taken = self.is_new and Study.objects.filter(slug=definition.slug).exists()
        if is_taken and not may(self.user, definition.slug, "owner"):
            words = gettext("The name %(slug)s is taken. Choose another one.")
            raise BadDefinitionError([words % {"slug": definition.slug}])
        self.check_version(definition.slug, definition.version)
        if not self.is_new:
            return publishing.save_draft(Study.objects.get(pk=self.instance.pk), definition)
        return publishing.store(definition, timezone.now())

    @staticmethod
    def shown(study: Study) -> str:
        return to_json(study.as_definition()).decode()


class PublishForm(forms.Form):
    reason = forms.CharField(
        label=_("Reason for publishing without a rehearsal"),
        required=False,
        max_length=2000,
        widget=forms.Textarea(attrs={"rows": 3}),
    )
    confirmed = forms.BooleanField(label=_("Yes, it is meant like this."), required=False)


class CopyForm(forms.Form):
    name = NameField()
    title = forms.CharField(label=_("Title"), max_length=200)


class MemberForm(forms.Form):
    """A researcher by user name or address; `invited` is an address without a staff account."""

    person = forms.CharField(
        label=_("User name or e-mail address"),
        max_length=254,
        help_text=_("People without an account get an invitation by e-mail."),
    )
    role = forms.ChoiceField(label=_("Role"), choices=StudyMember.Role)
    invited = ""

    def clean_person(self) -> User | None:
        """Return the user; None for a person to invite."""
        text = self.cleaned_data["person"].strip()
        known = User.objects.filter(Q(username=text) | Q(email__iexact=text), is_active=True)
        found = list(known[:2])
        user = found[0] if len(found) == 1 else None
        if user is not None and user.is_staff:
            return user
        self.invited = user.email if user is not None else text
        words = gettext("User not found. Enter an e-mail address to invite this person.")
        if user is not None:
            words = gettext(
                "This user has no access to the administration and no e-mail address for an "
                "invitation. An administrator must grant access first."
            )
        try:
            validate_email(self.invited)
        except forms.ValidationError as error:
            raise forms.ValidationError(words) from error
        return None


class LinksForm(forms.Form):
    count = forms.IntegerField(label=_("Number"), min_value=1, max_value=MOST_LINKS, initial=10)
    label = forms.CharField(
        label=_("Label"),
        required=False,
        max_length=110,
        help_text=_("Each link gets this label and a number."),
    )
    access = forms.ChoiceField(
        label=_("Access"),
        choices=[
            ("invitation", _("conditions for invited participants")),
            ("open", _("conditions for everyone")),
        ],
    )
    days = forms.IntegerField(
        label=_("Expires after (days)"),
        required=False,
        min_value=1,
        max_value=MOST_DAYS,
        help_text=_("Leave blank for no expiry."),
    )

    def __init__(self, study: StudyDefinition, *args: Any) -> None:
        super().__init__(*args)
        # A link to an access without conditions would turn its participant away at the drive.
        used = {condition.access for condition in study.conditions}
        access = self.fields["access"]
        access.choices = [one for one in access.choices if one[0] in used or not used]

    def expires_at(self, now: datetime.datetime) -> datetime.datetime | None:
        days = self.cleaned_data["days"]
        return None if days is None else now + datetime.timedelta(days=days)
