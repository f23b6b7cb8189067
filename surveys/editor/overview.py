"""The lists of the editor's overview, and the addresses of its forms and previews."""

from collections.abc import Iterable
from functools import partial
from typing import Any
from urllib.parse import urlencode

from django.urls import reverse
from django.utils.translation import get_language, gettext as _

from surveys.document_forms.parts import Document
from surveys.document_forms.problem_text import by_place, text_name
from surveys.documents import Problem, ProblemPlace, text_in
from surveys.editor.draft import EditorPlace
from surveys.editor.labels import GUIDE, kind_name, scale_name
from surveys.models import Questionnaire

Problems = dict[EditorPlace, list[str]]


def address(row: Questionnaire, place: EditorPlace | None = None) -> str:
    if place is None:
        return reverse("admin:surveys_questionnaire_editor", args=[row.pk])
    name, keys = ("part", [place.key]) if place.key else ("section", [])
    return reverse(f"admin:surveys_questionnaire_{name}", args=[row.pk, place.section, *keys])


def problem_texts(found: Iterable[Problem], whole: Document) -> Problems:
    def name_of(one: Problem) -> str:
        return text_name(GUIDE, form_for(one.place).part(whole), one.path)

    def form_for(place: ProblemPlace) -> EditorPlace:
        return EditorPlace(place.section, place.part or "")

    sentences = by_place(found, lambda one: one.text(_), name_of)
    return {form_for(place): texts for place, texts in sentences.items()}


def listed(row: Questionnaire, whole: Document, found: Problems) -> dict[str, Any]:
    pages, number = [], 0
    for n, page in enumerate(whole["pages"], start=1):
        questions = []
        for item in page["items"]:
            number += 1
            title = text_of(item["text"], whole) or _("No text yet")
            more = {"kind": kind_name(item["kind"]), "is_conditional": "show_if" in item}
            line = _line(row, EditorPlace("questions", item["key"]), f"{number}. {title}", found)
            questions.append(line | more)
        title = text_of(page.get("title", {}), whole)
        line = _line(row, EditorPlace("pages", page["key"]), title, found)
        is_last = n == len(whole["pages"])
        more = {"n": n, "preview": preview_of(row, n), "questions": questions, "is_last": is_last}
        pages.append(line | more)
    in_words = partial(text_of, whole=whole)
    names = {key: scale_name(points, in_words) for key, points in whole["scales"].items()}
    scales = [_line(row, EditorPlace("scales", key), name, found) for key, name in names.items()]
    about = _line(row, EditorPlace("about"), "", found)
    return {"pages": pages, "scales": scales, "about": about}


def _line(row: Questionnaire, place: EditorPlace, title: str, found: Problems) -> dict[str, Any]:
    url = address(row, place)
    return {"key": place.key, "title": title, "url": url, "problems": found.get(place)}


def preview_of(row: Questionnaire, page: int) -> str:
    start = reverse("admin:surveys_questionnaire_preview", args=[row.pk])
    return f"{start}?{urlencode({'page': page, 'language': get_language() or ''})}"


def text_of(text: Document, whole: Document) -> str:
    return text_in(text, [get_language() or "", *whole["languages"]])
