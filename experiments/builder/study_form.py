"""The form of a part of a study (surveys/document_forms/part_form.py): its guide, the levels of a
condition, which have a field for each factor of the study, and the questionnaire of a step, which
is chosen with its version.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from django import forms
from django.urls import reverse
from django.utils.html import format_html
from django.utils.translation import gettext

from experiments.builder.labels import GUIDE
from experiments.definition.design import Levels
from experiments.definition.step import AskingStep
from surveys.document_forms.fields import NONE, ValueField
from surveys.document_forms.part_form import PartForm
from surveys.document_forms.parts import AskedField, Document


class LevelField(ValueField):
    """The level that a condition has of one factor, or none yet."""

    def __init__(self, member: AskedField, factor: str, levels: Sequence[str], value: str) -> None:
        known = dict.fromkeys(("", *levels, value))
        listed = [(level, level or NONE) for level in known]
        super().__init__(member, "choice", forms.Select(choices=listed))
        self.label = f"{self.label}: {factor}"

    def refusal(self, value: Any) -> str:
        """Refuse nothing: which levels there are is the study's to say."""
        return ""


class VersionField(ValueField):
    """A questionnaire in one of its versions, "name:version"."""

    def __init__(self, member: AskedField, names: Mapping[str, str], value: str) -> None:
        listed = [*({value: value} | dict(names)).items()]
        super().__init__(member, "choice", forms.Select(choices=listed))
        address = reverse("admin:surveys_questionnaire_write")
        self.help_text = format_html(
            '<a href="{}">{}</a>', address, gettext("Write a questionnaire")
        )

    def refusal(self, value: Any) -> str:
        """Refuse a name that can be none."""
        return super().refusal(str(value).partition(":")[0])


class StudyPartForm(PartForm):
    """The form of a part of a study. Of what is `offered`, "versions" are the questionnaires."""

    guide = GUIDE

    def __init__(self, cls: type[Any], document: Document, **more: Any) -> None:
        self._version = document.get("version", 1) if issubclass(cls, AskingStep) else None
        super().__init__(cls, document, **more)

    def fields_of(self, member: AskedField, value: Any, name: str) -> Iterator[forms.BoundField]:
        """Add the field of a value, or those of the levels of a condition."""
        if self._version is not None and name == "questionnaire":
            asked, names = f"{value}:{self._version}", dict(self.offered.get("versions", {}))
            yield self.add(name, VersionField(member, names, asked), asked)
        elif member.annotation == Levels:
            yield from self._levels(member, dict(value or {}), name)
        else:
            yield from super().fields_of(member, value, name)

    def _levels(
        self, member: AskedField, chosen: dict[str, str], name: str
    ) -> Iterator[forms.BoundField]:
        start = f"{member.key}."
        factors = (key.removeprefix(start) for key in self.offered if key.startswith(start))
        for factor in dict.fromkeys((*factors, *chosen)):
            levels, level = self.offered.get(start + factor, ()), chosen.get(factor, "")
            yield self.add(
                f"{name}.{factor}", LevelField(member, factor, list(levels), level), level
            )

    @classmethod
    def read(
        cls, part: type[Any], sent: Any, *, only: Collection[str] = (), prefix: str = ""
    ) -> Document:
        """Return the document that a form makes; questionnaire and version are one choice."""
        document = super().read(part, sent, only=only, prefix=prefix)
        if issubclass(part, AskingStep) and "questionnaire" in document:
            document["questionnaire"], _colon, n = document["questionnaire"].partition(":")
            document["version"] = int(n[:6]) if n.isascii() and n.isdigit() else 1
        return document
