"""A question of a LimeSurvey file on its way into a draft, and what its kinds share."""

import math
from collections.abc import Callable

from django.utils.translation import gettext as _

from surveys.documents import Text
from surveys.importing.draft import Draft, Item
from surveys.importing.limesurvey.tables import LimeSurveyQuestion
from surveys.importing.parts import flags
from surveys.importing.report import Note


class LimeSurveyConversion:
    """One question of the file on its way into a draft."""

    def __init__(self, draft: Draft, note: Note, question: LimeSurveyQuestion) -> None:
        self.draft = draft
        self.note = note
        self.question = question

    def texts_of(self, question: LimeSurveyQuestion, field: str = "question") -> Text:
        """Return a text of a question or subquestion."""
        return self.draft.text(
            {lang: row.get(field, "") for lang, row in question.texts.items()}, self.note
        )

    def text(self) -> Text:
        """Return the question; its code where it has none."""
        text = self.texts_of(self.question)
        if not text:
            self.note.changed(_("It has no text; its name is shown."))
        return text or self.draft.same(self.question.title)

    def common(self) -> Item:
        """Return the fields that every item made of it has."""
        wish = self.question.row.get("mandatory", "N")
        if wish == "S":
            self.note.changed(_("The file requests an answer; here it is optional."))
        hint = self.texts_of(self.question, "help")
        return flags(required=wish == "Y", hint=hint)

    def answers(self, scale_id: str = "0") -> dict[str, Text]:
        """Return the labels of the answers by code."""
        return {
            answer.code: self.draft.text(answer.texts, self.note)
            for answer in self.question.answers
            if answer.scale == scale_id
        }

    def parts(self, scale_id: str = "0") -> list[tuple[LimeSurveyQuestion, Text]]:
        """Return the subquestions with their texts."""
        return [
            (part, self.texts_of(part) or self.draft.same(part.title))
            for part in self.question.parts
            if part.row.get("scale_id", "0") in {scale_id, ""}
        ]

    def order(self, name: str) -> str:
        """Return the order of answers or subquestions."""
        wanted = self.question.attribute(name)
        old = self.question.attribute("random_order") == "1"
        if wanted.startswith("random") or old:
            return "shuffled"
        if wanted not in {"", "normal"}:
            self.note.changed(
                _("Its order (%(order)s) is replaced by the written order.") % {"order": wanted}
            )
        return ""

    def number(self, name: str) -> float | None:
        """Return an attribute that is a finite number; anything else is noted."""
        value = self.question.attribute(name).strip()
        if not value:
            return None
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if math.isfinite(number):
            return number
        self.note.changed(
            _("Its rule %(rule)s is not checked.") % {"rule": f"{name} = {value[:60]}"}
        )
        return None


def key_for(asked: LimeSurveyConversion, part: LimeSurveyQuestion | None = None) -> str:
    """Return the key of a question, or of one of its subquestions."""
    title = asked.question.title
    wanted = title if part is None else f"{title}_{part.title}"
    return asked.draft.key(wanted, asked.note)


def by_part(
    asked: LimeSurveyConversion, make: Callable[[LimeSurveyQuestion], Item], remark: str
) -> list[Item]:
    """Return an item for each subquestion, with the question's text before its own."""
    asked.note.changed(remark)
    text, common = asked.text(), asked.common()
    return [
        {
            "key": key_for(asked, part),
            "text": asked.draft.joined(text, label, by=" – "),
            **common,
            **make(part),
        }
        for part, label in asked.parts()
    ]


def numbered(asked: LimeSurveyConversion, least: int, most: int) -> str:
    """Return the name of a scale of numbers."""
    return asked.draft.scale(
        [
            (n, asked.draft.same(str(n)) if n in {least, most} else {})
            for n in range(least, most + 1)
        ]
    )
