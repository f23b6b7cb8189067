"""Forms that store definitions from a JSON file or its text."""

from functools import partial
from typing import Any, ClassVar

from django import forms
from django.conf import settings
from django.urls import reverse
from django.utils import timezone
from django.utils.functional import lazy
from django.utils.html import format_html
from django.utils.safestring import SafeString
from django.utils.translation import gettext, gettext_lazy as _

from surveys.definition import to_json
from surveys.document_forms.fields import language_name
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError
from surveys.importing.reading import MAX_SLUG
from surveys.models import Questionnaire
from surveys.problems import MAX_BYTES, parse
from surveys.questionnaires import store


def _format_reference(page: str) -> SafeString:
    link = '<a href="{}" target="_blank" rel="noopener">{}</a>'
    return format_html(link, reverse("reference", args=[page]), gettext("Format reference"))


BOX = {"rows": 30, "cols": 100, "spellcheck": "false", "class": "vLargeTextField"}
# A link to the page of the site that describes a file format, opened beside the form.
format_reference = lazy(_format_reference, SafeString)

NameField = partial(forms.RegexField, r"^[a-z][a-z0-9-]*$", label=_("Name"), max_length=MAX_SLUG)
LanguagesField = partial(
    forms.MultipleChoiceField,
    label=_("Languages"),
    choices=lambda: [(code, language_name(code)) for code, _label in settings.LANGUAGES],
    widget=forms.CheckboxSelectMultiple,
)


class DocumentForm(forms.ModelForm):
    """A definition; `reference` is the page of its format, `limit` its greatest size in bytes."""

    reference: ClassVar[str]
    limit: ClassVar[int]

    file = forms.FileField(label=_("JSON file"), required=False)
    document = forms.CharField(
        label=_("or paste its text"), required=False, strip=False, widget=forms.Textarea(BOX)
    )

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.fields["file"].help_text = format_reference(self.reference)
        self.stored: Any = None
        self.is_new = self.instance._state.adding

    def sent(self) -> bytes:
        upload, text = self.cleaned_data.get("file"), self.cleaned_data.get("document", "")
        document: bytes = text.encode() if upload is None else upload.read(self.limit + 1)
        return document if document.strip() else b""

    def check_version(self, slug: str, version: int) -> None:
        """Raise BadDefinitionError for a version that exists, or is not the one to change."""
        own = self.instance.slug, self.instance.version
        if not self.is_new and own != (slug, version):
            words = gettext("This is version %(n)d of %(slug)s. Its name and version can't change.")
            raise BadDefinitionError([words % {"n": own[1], "slug": own[0]}])
        rows = type(self.instance).objects.filter(slug=slug, version=version)
        if self.is_new and rows.exists():
            words = gettext(
                "Version %(n)d of %(slug)s already exists. Edit that one, or give yours another "
                "version number."
            )
            raise BadDefinitionError([words % {"n": version, "slug": slug}])


class QuestionnaireForm(DocumentForm):
    reference, limit = "questionnaires", MAX_BYTES

    class Meta:
        model = Questionnaire
        fields = ()

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if not self.is_new:
            self.fields["document"].initial = to_json(self.instance.as_definition()).decode()

    def clean(self) -> dict[str, Any]:
        """Store the definition already here: that it was just frozen is an error of the form."""
        cleaned = super().clean() or self.cleaned_data
        if self.errors:
            return cleaned
        document = self.sent()
        if not document:
            raise forms.ValidationError(_("Choose a file or paste its text."))
        try:
            definition = parse(document)
            self.check_version(definition.slug, definition.version)
            self.stored = store(definition, timezone.now())
        except BadDefinitionError as error:
            raise forms.ValidationError(sentences(error.problems)) from error
        return cleaned
