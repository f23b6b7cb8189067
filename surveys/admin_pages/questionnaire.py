"""Pages of the administration for a questionnaire: preview, export, answers, new version, and
adding those that come with the site.
"""

from typing import Any
from urllib.parse import urlencode
from uuid import UUID

from django.contrib import messages
from django.contrib.auth.decorators import permission_required
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase, HttpResponseRedirect
from django.shortcuts import get_object_or_404, redirect, render
from django.urls import reverse
from django.utils import timezone, translation
from django.utils.translation import gettext as _, ngettext
from django.views.decorators.http import require_POST, require_safe

from accounts import audit
from surveys.definition import Definition, language_for, to_json
from surveys.document_forms.fields import language_name
from surveys.documents import spoken
from surveys.downloads import as_long_csv, as_wide_csv
from surveys.models import Questionnaire, Response
from surveys.page_form import Reader, page_form_of
from surveys.questionnaires import next_version, shipped_and_not_stored, store

VIEW, ADD, READ = "surveys.view_questionnaire", "surveys.add_questionnaire", "surveys.view_response"


@require_safe
@permission_required(VIEW, raise_exception=True)
def preview(request: HttpRequest, pk: UUID) -> HttpResponse:
    """Show a page with all of its questions as respondents see it: `?page=2&language=es&seed=7`."""
    row = get_object_or_404(Questionnaire, pk=pk)
    definition = row.as_definition()
    language = language_for(definition, request.GET.get("language", ""))
    number, seed = _whole(request.GET.get("page", ""), 1), _whole(request.GET.get("seed", ""), 0)
    if not 1 <= number <= len(definition.pages):
        raise Http404
    reader = Reader(language, seed, timezone.now(), sees_all=True)
    with translation.override(language):
        context: dict[str, Any] = {
            "form": page_form_of(definition, number - 1, reader, range(len(definition.pages))),
            "title": spoken(definition.title, language),
            "intro": spoken(definition.intro, language) if number == 1 else "",
            "language": language,
            "preview": _around(row, definition, number, language),
        }
        return render(request, "surveys/page.html", context)


def _around(row: Questionnaire, definition: Definition, page: int, language: str) -> dict[str, Any]:
    address = reverse("admin:surveys_questionnaire_preview", args=[row.pk])

    def link(label: str, n: int, other: str) -> dict[str, Any]:
        url = f"{address}?{urlencode({'page': n, 'language': other})}"
        return {"label": label, "url": url, "is_here": (n, other) == (page, language)}

    pages = range(1, len(definition.pages) + 1)
    return {
        "name": str(row),
        "admin": reverse("admin:surveys_questionnaire_change", args=[row.pk]),
        "pages": [link(_("Page %(n)d") % {"n": n}, n, language) for n in pages],
        "languages": [link(language_name(one), page, one) for one in definition.languages],
    }


def _whole(text: str, default: int) -> int:
    is_number = text.isascii() and text.isdigit() and len(text) <= len("2147483648")
    return int(text) if is_number else default


@require_safe
@permission_required(VIEW, raise_exception=True)
def export(_request: HttpRequest, pk: UUID) -> HttpResponse:
    row = get_object_or_404(Questionnaire, pk=pk)
    headers = {"Content-Disposition": f'attachment; filename="{row.slug}-{row.version}.json"'}
    document = to_json(row.as_definition())
    return HttpResponse(document, content_type="application/json", headers=headers)


@require_safe
@permission_required(READ, raise_exception=True)
def answers(request: HttpRequest, pk: UUID, shape: str) -> HttpResponseBase:
    row = get_object_or_404(Questionnaire, pk=pk)
    audit.note("answers_exported", actor=request.user, thing=row, detail=row.slug)
    if shape == "wide":
        return as_wide_csv(row.slug)
    return as_long_csv(Response.objects.filter(questionnaire__slug=row.slug), f"{row.slug}-long")


@require_POST
@permission_required(ADD, raise_exception=True)
def new_version(request: HttpRequest, pk: UUID) -> HttpResponseRedirect:
    copy = next_version(get_object_or_404(Questionnaire, pk=pk), timezone.now())
    words = _("You can edit version %(n)d until somebody answers it.")
    messages.success(request, words % {"n": copy.version})
    return redirect("admin:surveys_questionnaire_editor", copy.pk)


@require_POST
@permission_required(ADD, raise_exception=True)
def take_shipped(request: HttpRequest) -> HttpResponseRedirect:
    wanted = request.POST.get("questionnaire", "")
    new = [one for one in shipped_and_not_stored() if wanted in {"", one.slug}]
    for definition in new:
        store(definition, timezone.now())
    text = ngettext("%(n)d questionnaire was added.", "%(n)d questionnaires were added.", len(new))
    messages.success(request, text % {"n": len(new)})
    return redirect("admin:surveys_questionnaire_changelist")


PAGES = (
    ("shipped/", take_shipped, "shipped"),
    ("<uuid:pk>/preview/", preview, "preview"),
    ("<uuid:pk>/export.json", export, "export"),
    ("<uuid:pk>/answers-<str:shape>.csv", answers, "answers"),
    ("<uuid:pk>/new-version/", new_version, "new_version"),
)
