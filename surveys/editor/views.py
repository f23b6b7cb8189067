"""The editor of questionnaires, which needs neither JSON nor JavaScript.

The overview has the pages with their questions, and the scales; each has a form of its own. Every
button of a form sends the whole form, so that no input is lost. Incomplete drafts can be saved;
their problems are shown where they are corrected.
"""

from collections.abc import Callable
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django import forms
from django.conf import settings
from django.contrib import admin, messages
from django.contrib.admin.models import CHANGE, LogEntry
from django.contrib.auth.decorators import permission_required
from django.core.exceptions import PermissionDenied
from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import get_object_or_404, redirect, render
from django.utils import timezone
from django.utils.translation import get_language, gettext as _, gettext_lazy
from django.views.decorators.http import require_http_methods

from surveys.definition import Definition
from surveys.document_forms.fields import Offered, language_name
from surveys.document_forms.part_form import MEANWHILE, SubmittedPart, number, pressed
from surveys.document_forms.parts import Document, change
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError, ChangedMeanwhileError
from surveys.editor import draft
from surveys.editor.draft import EditorPlace
from surveys.editor.labels import CHOICES, READY, EditorForm, kind_name, ready_points, scale_name
from surveys.editor.overview import address, listed, preview_of, problem_texts, text_of
from surveys.forms import LanguagesField, NameField
from surveys.importing.reading import slug_for
from surveys.item import Question
from surveys.models import Questionnaire
from surveys.questionnaires import begin_empty, problems_of, save_draft
from surveys.questions import TYPES

VIEW, ADD, EDIT = (f"surveys.{verb}_questionnaire" for verb in ("view", "add", "change"))
# In the session: title and address of the page of a study that the editor was opened from.
OPENED_FROM = "questionnaire_opened_from"
TITLES = {
    "about": gettext_lazy("About the questionnaire"),
    "pages": gettext_lazy("Page"),
    "scales": gettext_lazy("Scale"),
}


class WriteForm(forms.Form):
    title = forms.CharField(label=gettext_lazy("Title"), max_length=200)
    languages = LanguagesField(initial=lambda: [(get_language() or "en").partition("-")[0]])
    name = NameField(
        required=False,
        help_text=gettext_lazy(
            "Lower-case letters, digits and “-”. Used in the data. Leave blank to use the title."
        ),
    )


def leads_here(request: HttpRequest, title: str, url: str) -> None:
    opened_from = {"title": title, "url": url}
    if request.session.get(OPENED_FROM) != opened_from:
        request.session[OPENED_FROM] = opened_from


@require_http_methods(["GET", "HEAD", "POST"])
@permission_required(ADD, raise_exception=True)
def write(request: HttpRequest) -> HttpResponse:
    form = WriteForm(request.POST or None)
    if form.is_valid():
        title, name = form.cleaned_data["title"], form.cleaned_data["name"]
        languages = form.cleaned_data["languages"]
        try:
            row = begin_empty(name or slug_for(title), title, languages, timezone.now())
        except BadDefinitionError as error:
            form.add_error("name", sentences(error.problems))
        else:
            return redirect(address(row))
    return _page(request, "write", {"title": _("Write a questionnaire"), "form": form})


@require_http_methods(["GET", "HEAD", "POST"])
def overview(request: HttpRequest, pk: UUID) -> HttpResponse:
    row = _row(request, pk)
    whole = whole_of(row)
    if request.method == "POST":
        return _press(request, row, whole)
    found = problem_texts(problems_of(row), whole)
    context = {
        **listed(row, whole, found),
        "title": row.title,
        "languages": [language_name(code) for code in whole["languages"]],
        "kinds": [(kind, kind_name(kind)) for kind in TYPES],
        "ready": [(name, words) for name, (words, _labels) in READY.items()],
        "count": sum(len(texts) for texts in found.values()),
    }
    return _page(request, "editor", context, row)


@require_http_methods(["GET", "HEAD", "POST"])
def edit(request: HttpRequest, pk: UUID, section: str, key: str = "") -> HttpResponse:
    row, place = _row(request, pk), EditorPlace(section, key)
    whole = whole_of(row)
    is_known = section in {*TITLES, "questions"} and bool(key) != (section == "about")
    former = place.part(whole) if is_known else None
    if former is None and not (is_known and request.POST.get("kind") in TYPES):
        raise Http404
    if request.method != "POST":
        return _show(request, row, place, SubmittedPart(former or {}))
    # If another user has removed the question, the input is shown again.
    known = former or {"kind": request.POST["kind"], "key": key}
    sent = _read(request, place, known, whole)
    if former is None:
        sent.above.append(_("Not saved: someone else removed this question."))
    if not sent.is_refused:
        refusal = keep(request, row, place.put(whole, sent.part))
        sent.above += [refusal] if refusal else []
    if sent.is_refused:
        return _show(request, Questionnaire.objects.get(pk=pk), place, sent, known)
    user: Any = request.user
    what = f"Changed: {section} {key}"
    LogEntry.objects.log_actions(user.pk, [row], CHANGE, what, single_object=True)
    messages.success(request, _("Saved."))
    if request.POST.get("do") == "done":
        return redirect(f"{address(row)}#at-{sent.part.get('key', key)}")
    there = EditorPlace(section, sent.part.get("key", key) if key else "")
    return redirect(address(row, there) + (f"#{sent.anchor}" if sent.anchor else ""))


def whole_of(row: Questionnaire) -> Document:
    document: Document = msgspec.json.decode(msgspec.json.encode(row.as_definition()))
    return {"scales": {}, "topics": [], **document}


def keep(request: HttpRequest, row: Questionnaire, whole: Document) -> str:
    if request.POST.get("sha256") != row.sha256:
        return str(MEANWHILE)
    asked = {item.get("scale") for page in whole["pages"] for item in page["items"]}
    for name in READY.keys() & (asked | whole["scales"].keys()):
        points = whole["scales"].get(name, ())
        whole["scales"][name] = ready_points(name, whole["languages"], points)
    try:
        save_draft(row, msgspec.convert(whole, Definition))
    except ChangedMeanwhileError:
        return str(MEANWHILE)
    return ""


def _press(request: HttpRequest, row: Questionnaire, whole: Document) -> HttpResponse:
    """Perform the action of a button, `add|up|down|copy|remove:<section>:<key>:<kind>`."""
    verb, section, key, kind = pressed(request.POST, 4)
    place = EditorPlace(section, key)
    made = _added(whole, place, kind) if verb == "add" else None
    if verb != "add":
        draft.arrange(whole, verb, place)
    if refused := keep(request, row, whole):
        messages.error(request, refused)
    elif made is not None and made.section != "pages":
        return redirect(address(row, made))
    return redirect(f"{address(row)}#at-{(made or place).key}")


def _added(whole: Document, place: EditorPlace, kind: str) -> EditorPlace | None:
    """Add a page, a question to a page, or an offered or empty scale; return its place."""
    if place.section == "pages":
        key = draft.numbered("page_", draft.keys_in(whole))
        whole["pages"].append({"key": key, "items": []})
        return EditorPlace("pages", key)
    if place.section == "scales":
        name = kind if kind in READY else draft.numbered("scale_", whole["scales"])
        blank = [{"value": 1}, {"value": 2}]
        points = ready_points(name, whole["languages"]) if kind in READY else blank
        whole["scales"].setdefault(name, points)
        return EditorPlace("scales", name)
    page = EditorPlace("pages", place.key).part(whole)
    if page is None or kind not in TYPES:
        return None
    question = draft.new_question(kind, next(iter((*whole["scales"], *READY))), whole)
    page["items"].append(question)
    return EditorPlace("questions", question["key"])


def _read(
    request: HttpRequest, place: EditorPlace, former: Document, whole: Document
) -> SubmittedPart:
    """Return a form after its button: `save`, `done`, `add:<list>`, `remove|up|down:<list>:<n>`."""
    cls = place.cls(former)
    part = draft.complete(EditorForm.read(cls, request.POST, only=place.only), former, whole)
    if part.get("show_if"):
        questions = list(msgspec.convert(whole, Definition).questions())
        draft.type_answers(part["show_if"], former.get("show_if"), questions)
    verb, name, n = pressed(request.POST)
    anchor, values = name, EditorForm.list_in(part, name, cls, place.only)
    if values is not None and verb == "add":
        values.append(draft.new_entry(cls, name, part, whole))
        anchor = f"{name}.{len(values) - 1}"
    elif values is not None:
        values[:] = change(values, verb, number(n))
        if name == "points":
            # Only the labels move: values must increase.
            numbers = [point["value"] for point in values]
            if all(isinstance(one, int) for one in numbers):
                numbers.sort()
            values[:] = [one | {"value": n} for one, n in zip(values, numbers, strict=True)]
    offered = _offered(whole, place, part)
    form = EditorForm(cls, part, offered=offered, only=place.only, is_sent=True)
    return SubmittedPart(part, form.refusals, anchor=anchor)


def _show(
    request: HttpRequest,
    row: Questionnaire,
    place: EditorPlace,
    sent: SubmittedPart,
    former: Document | None = None,
) -> HttpResponse:
    whole = whole_of(row)
    former = place.part(whole) or former or sent.part
    given: Document = {"languages": whole["languages"], "only": place.only}
    given |= {"offered": _offered(whole, place, sent.part), "is_sent": bool(sent.errors)}
    form = EditorForm(place.cls(former), sent.part, **given)
    kind = former.get("kind", "")
    keys = [{page["key"], *(item["key"] for item in page["items"])} for page in whole["pages"]]
    page = next((n for n, inside in enumerate(keys, 1) if place.key in inside), 1)
    title = kind_name(kind) if kind else TITLES[place.section]
    preview = preview_of(row, page) + (f"#q-{place.key}" if kind else "")
    problems = problem_texts(problems_of(row), whole).get(place, ())
    context = {"form": form, "kind": kind, "above": sent.above, "has_errors": bool(sent.errors)}
    context |= {"title": title, "problems": problems, "preview": preview}
    return _page(request, "editor_part", context, row, status=422 if sent.is_refused else 200)


def _offered(whole: Document, place: EditorPlace, part: Document) -> Offered:
    definition, text = msgspec.convert(whole, Definition), partial(text_of, whole=whole)
    texts = {one.key: _in_full(one, text) for one in definition.questions()}
    scales = {name: scale_name(points, text) for name, points in whole["scales"].items()}
    before = {one.key: one for one in draft.earlier(definition, place)}
    asked = before.get((part.get("show_if") or {}).get("item", ""))
    answers = asked.labelled_values if asked is not None else ()
    scored = [one.key for one in definition.questions() if one.score_values]
    return {
        "languages": list(dict.fromkeys([*dict(settings.LANGUAGES), *whole["languages"]])),
        "scale": {**{name: str(words) for name, (words, _labels) in READY.items()}, **scales},
        "ItemCondition.item": {key: texts[key] for key in before},
        "ItemCondition.one_of": {str(n): text(dict(label)) or str(n) for n, label in answers},
        "outcome": list(CHOICES["outcome"]),
        "QuestionTopic.items": {key: texts[key] for key in scored},
    }


def _in_full(question: Question, text: Callable[[Document], str]) -> str:
    """Return the text of a question; of a row, after that of its grid."""
    both = (question.item.text, question.text) if question.row is not None else (question.text,)
    return " · ".join(filter(None, (text(dict(one)) for one in both))) or question.key


def _row(request: HttpRequest, pk: UUID) -> Questionnaire:
    """Return a questionnaire to view or, for a POST, to change."""
    user: Any = request.user
    row = get_object_or_404(Questionnaire, pk=pk)
    is_change = request.method == "POST"
    if not user.has_perm(EDIT if is_change else VIEW) or (is_change and row.frozen_at is not None):
        raise PermissionDenied
    return row


def _page(
    request: HttpRequest,
    name: str,
    more: dict[str, Any],
    row: Questionnaire | None = None,
    status: int = 200,
) -> HttpResponse:
    user: Any = request.user
    is_draft = row is not None and row.frozen_at is None
    context = {
        **admin.site.each_context(request),
        "opts": Questionnaire._meta,
        "questionnaire": row,
        "may_change": is_draft and user.has_perm(EDIT),
        "may_add": user.has_perm(ADD),
        "opened_from": request.session.get(OPENED_FROM),
        **more,
    }
    page = f"admin/surveys/questionnaire/{name}.html"
    return render(request, page, context, status=status)


PAGES = (
    ("write/", write, "write"),
    ("<uuid:pk>/edit/", overview, "editor"),
    ("<uuid:pk>/edit/<slug:section>/", edit, "section"),
    ("<uuid:pk>/edit/<slug:section>/<slug:key>/", edit, "part"),
)
