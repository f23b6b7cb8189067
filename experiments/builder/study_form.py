"""The form of a part of a study (surveys/document_forms/part_form.py). Levels of a factor have a
field for each setting that it changes; a questionnaire is chosen with its version, and what a
hypothesis expects as one sentence.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from django import forms
from django.urls import reverse
from django.utils.html import format_html
from django.utils.translation import gettext

from experiments.builder.labels import GUIDE
from experiments.definition.design import Factor, Level, LevelSettings
from experiments.definition.plan import Hypothesis
from experiments.definition.schema import Condition
from experiments.definition.step import AskingStep
from experiments.definition.steps.instructions import OWN_MEDIA
from experiments.instruction_media import ACCEPTED, is_video
from surveys.document_forms.fields import NONE, ValueField
from surveys.document_forms.part_form import Group, PartForm
from surveys.document_forms.parts import AskedField, Document

NO_FIELDS = ("",)  # `only` for no fields
SHARED = "shared."
UNCHOSEN = {"different:::"}


class SeveralField(ValueField):
    """A choice of several values of a part, joined by colons."""

    def __init__(
        self, member: AskedField, groups: Mapping[str, Mapping[str, Any]], value: str
    ) -> None:
        is_known = any(value in group for group in groups.values())
        listed: list[Any] = [] if is_known else [(value, NONE if value in UNCHOSEN else value)]
        for name, group in groups.items():
            listed += [(name, list(group.items()))] if name else group.items()
        super().__init__(member, "choice", forms.Select(choices=listed))

    def refusal(self, value: Any) -> str:
        return super().refusal(str(value).partition(":")[0])


class MediaInput(forms.Select):
    """A choice of pictures, with an upload below it and a preview of an uploaded one."""

    needs_multipart_form = True

    def render(self, name: str, value: Any, attrs: Any = None, renderer: Any = None) -> Any:
        chosen = str(value or "")
        shown = format_html("")
        if chosen.startswith(OWN_MEDIA):
            tag = "<video src='{}' controls></video>"
            tag = tag if is_video(chosen) else "<img src='{}' alt=''>"
            shown = format_html(tag, reverse("study_media", args=[chosen]))
        tag = '<input type="file" name="{}.file" accept="{}" aria-label="{}">'
        file = format_html(tag, name, ACCEPTED, gettext("Own picture or video"))
        return super().render(name, value, attrs, renderer) + shown + file


class StudyPartForm(PartForm):
    """The form of a part of a study. `offered` also has "versions" of questionnaires, "claims" of
    hypotheses, and "shared", the fields that all conditions share.
    """

    guide = GUIDE

    def __init__(self, cls: type[Any], document: Document, **more: Any) -> None:
        self._around: Document = {}  # the step, factor or hypothesis whose fields are made
        super().__init__(cls, document, **more)

    def _parts(
        self, cls: type[Any], document: Document, prefix: str, only: Collection[str] = ()
    ) -> Iterator[forms.BoundField | Group]:
        if cls is LevelSettings:
            only = self._around.get("changes") or NO_FIELDS
        elif cls is Condition and prefix == SHARED:
            only = tuple(self.offered["shared"]) or NO_FIELDS
        elif issubclass(cls, Factor | AskingStep | Hypothesis):
            self._around = document
        for part in super()._parts(cls, document, prefix, only):
            is_group = isinstance(part, Group)
            if not is_group or part.parts or part.is_list or part.switch or part.kind:
                yield part

    def fields_of(self, member: AskedField, value: Any, name: str) -> Iterator[forms.BoundField]:
        around = self._around
        if member.called.endswith("Step.questionnaire"):
            asked = f"{value}:{around.get('version', 1)}"
            field = SeveralField(member, {"": self.offered.get("versions", {})}, asked)
            link = (reverse("admin:surveys_questionnaire_write"), gettext("Write a questionnaire"))
            field.help_text = format_html('<a href="{}">{}</a>', *link)
            yield self.add(name, field, asked)
        elif member.called == "InstructionPage.picture":
            named = {"": str(NONE), **self.offered.get("pictures", {})}
            field = SeveralField(member, {"": named}, value or "")
            field.widget = MediaInput(choices=field.widget.choices)
            yield self.add(name, field, value)
        elif member.called == "Hypothesis.direction":
            asked = claim_of(around)
            field = SeveralField(member, self.offered.get("claims", {}), asked)
            yield self.add(name, field, asked)
        else:
            yield from super().fields_of(member, value, name)

    def fix(self, name: str, words: str) -> None:
        if name in self.fields:
            self[name].help_text = words
            self.fields[name].widget.attrs["disabled"] = True

    @classmethod
    def read(
        cls, part: type[Any], sent: Any, *, only: Collection[str] = (), prefix: str = ""
    ) -> Document:
        """Return the document of a form; `was` is the key that a factor or level was shown with."""
        if part is LevelSettings:
            factor = prefix.partition(".levels.")[0]
            only = sent.getlist(f"{factor}.changes") or NO_FIELDS
        elif part is Condition and prefix == SHARED:
            only = sent.getlist("shared_fields") or NO_FIELDS
        document = super().read(part, sent, only=only, prefix=prefix)
        if issubclass(part, Factor | Level):
            document["was"] = sent.get(prefix.removesuffix("."), "")
        elif issubclass(part, AskingStep) and "questionnaire" in document:
            document["questionnaire"], _colon, n = document["questionnaire"].partition(":")
            document["version"] = int(n[:6]) if n.isascii() and n.isdigit() else 1
        elif part is Hypothesis and "direction" in document:
            document |= claimed(document["direction"])
        return document


def claim_of(hypothesis: Mapping[str, Any]) -> str:
    """Return "direction:analysis:contrast:effect", with dots for the colons of the effect."""
    effect = hypothesis.get("effect", "").replace(":", ".")
    contrast = hypothesis.get("contrast") or ""
    direction = hypothesis.get("direction", "different")
    return f"{direction}:{hypothesis.get('analysis', '')}:{contrast}:{effect}"


def claimed(claim: str) -> Document:
    direction, analysis, contrast, effect = (*claim.split(":"), "", "", "", "")[:4]
    number = int(contrast[:3]) if contrast.isascii() and contrast.isdigit() else None
    found = {"direction": direction, "analysis": analysis, "contrast": number}
    found["effect"] = effect.replace(".", ":")
    return {key: value for key, value in found.items() if value}
