"""What the overview of the editor lists, and the addresses of what is edited and previewed."""

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any
from urllib.parse import urlencode

from django.urls import reverse
from django.utils.translation import get_language
from django.utils.translation import gettext as _

from surveys.document_forms.parts import Document
from surveys.document_forms.problem_text import by_place, text_name
from surveys.documents import Problem, ProblemPlace, text_in
from surveys.editor.draft import EditorPlace
from surveys.editor.labels import GUIDE, kind_name, scale_name
from surveys.models import Questionnaire

ABOUT = EditorPlace("about")


def address(row: Questionnaire, place: EditorPlace | None = None) -> str:
    """Return the address of the overview, or of a part's form."""
    if place is None:
        return reverse("admin:surveys_questionnaire_editor", args=[row.pk])
    if not place.key:
        return reverse("admin:surveys_questionnaire_section", args=[row.pk, place.section])
    return reverse("admin:surveys_questionnaire_part", args=[row.pk, place.section, place.key])


def told(found: Iterable[Problem], whole: Document) -> dict[EditorPlace, list[str]]:
    """Return what is said of problems, by the page on which each is corrected."""

    def name_of(one: Problem) -> str:
        return text_name(GUIDE, _page_for(one.place).part(whole), one.path)

    said = by_place(found, lambda one: one.text(_), name_of)
    return {_page_for(place): texts for place, texts in said.items()}


def _page_for(place: ProblemPlace) -> EditorPlace:
    return EditorPlace(place.section, place.part or "")


def pages_of(
    row: Questionnaire, whole: Document, found: dict[EditorPlace, list[str]]
) -> Iterator[dict[str, Any]]:
    """Yield the pages with their questions, which are numbered through."""
    number, nothing = 0, _("No text yet")
    for n, page in enumerate(whole["pages"], start=1):
        questions = []
        for item in page["items"]:
            number += 1
            place = EditorPlace("questions", item["key"])
            questions.append(
                {
                    "key": item["key"],
                    "title": f"{number}. {text_of(item['text'], whole) or nothing}",
                    "kind": kind_name(item["kind"]),
                    "url": address(row, place),
                    "told": found.get(place),
                    "is_conditional": "show_if" in item,
                }
            )
        place = EditorPlace("pages", page["key"])
        yield {
            "key": page["key"],
            "n": n,
            "title": text_of(page.get("title", {}), whole),
            "url": address(row, place),
            "preview": preview_of(row, n),
            "told": found.get(place),
            "questions": questions,
            "is_last": n == len(whole["pages"]),
        }


def scales_of(
    row: Questionnaire, whole: Document, found: dict[EditorPlace, list[str]]
) -> Iterator[dict[str, Any]]:
    """Yield the scales."""
    for name, points in whole["scales"].items():
        place = EditorPlace("scales", name)
        title = scale_name(points, partial(text_of, whole=whole))
        yield {"key": name, "title": title, "url": address(row, place), "told": found.get(place)}


def preview_of(row: Questionnaire, page: int) -> str:
    """Return the address of a page as respondents see it."""
    start = reverse("admin:surveys_questionnaire_preview", args=[row.pk])
    return f"{start}?{urlencode({'page': page, 'language': get_language() or ''})}"


def text_of(text: Document, whole: Document) -> str:
    """Return a text in the language of the page, or in one that it has."""
    return text_in(text, [get_language() or "", *whole["languages"]])
