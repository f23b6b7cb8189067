"""The form with which a questionnaire comes into the database: a JSON file, or the same text."""

from typing import Any

from django import forms
from django.urls import reverse
from django.utils import timezone
from django.utils.functional import lazy
from django.utils.html import format_html
from django.utils.safestring import SafeString
from django.utils.translation import gettext
from django.utils.translation import gettext_lazy as _

from surveys.definition import Definition, to_json
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError
from surveys.models import Questionnaire
from surveys.problems import MAX_BYTES, parse
from surveys.questionnaires import store


def _format_reference(page: str) -> SafeString:
    return format_html(
        '<a href="{}" target="_blank" rel="noopener">{}</a>',
        reverse("reference", args=[page]),
        gettext("Format reference"),
    )


# A link to the page of the site that describes a file format, opened beside the form.
format_reference = lazy(_format_reference, SafeString)


class QuestionnaireForm(forms.ModelForm):
    """A definition; every problem of it is told at once."""

    file = forms.FileField(
        label=_("JSON file"),
        required=False,
        help_text=format_reference("questionnaires"),
    )
    document = forms.CharField(
        label=_("or paste its text"),
        required=False,
        strip=False,
        max_length=MAX_BYTES,
        widget=forms.Textarea(
            attrs={"rows": 30, "cols": 100, "spellcheck": "false", "class": "vLargeTextField"}
        ),
    )

    class Meta:
        model = Questionnaire
        fields = ()

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if not self.instance._state.adding:
            self.fields["document"].initial = to_json(self.instance.as_definition()).decode()
        self.stored: Questionnaire | None = None

    def clean(self) -> dict[str, Any]:
        """Store the definition. Here and not later, so that a version that was frozen a moment ago
        is told like any other problem.
        """
        cleaned = super().clean() or self.cleaned_data
        if self.errors:
            return cleaned
        upload = cleaned.get("file")
        document = (
            upload.read(MAX_BYTES + 1)
            if upload is not None
            else cleaned.get("document", "").encode()
        )
        if not document.strip():
            raise forms.ValidationError(_("Choose a file or paste its text."))
        try:
            definition = parse(document)
            self._check_name(definition)
            self.stored = store(definition, timezone.now())
        except BadDefinitionError as error:
            raise forms.ValidationError(sentences(error.problems)) from error
        return cleaned

    def _check_name(self, definition: Definition) -> None:
        """Keep an import from replacing what is there unseen, and a change from becoming another
        questionnaire.
        """
        name, own = (
            (definition.slug, definition.version),
            (self.instance.slug, self.instance.version),
        )
        if not self.instance._state.adding:
            if name != own:
                told = _("This is version %(n)d of %(slug)s. Its name and version can't change.")
                raise BadDefinitionError([told % {"n": own[1], "slug": own[0]}])
        elif Questionnaire.objects.filter(
            slug=definition.slug, version=definition.version
        ).exists():
            told = _(
                "Version %(n)d of %(slug)s already exists. Edit that one, or give yours another "
                "version number."
            )
            raise BadDefinitionError([told % {"n": name[1], "slug": name[0]}])
