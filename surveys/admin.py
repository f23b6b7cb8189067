"""Questionnaires and responses in the administration; answers are never edited."""

from itertools import chain
from typing import Any

import msgspec
from django.contrib import admin
from django.db.models import Count, Model, QuerySet
from django.http import HttpRequest, HttpResponse
from django.template.loader import render_to_string
from django.urls import URLPattern, path, reverse
from django.utils.html import format_html
from django.utils.translation import get_language, gettext, gettext_lazy as _

from accounts import audit
from accounts.admin_filters import ShownFilters
from surveys.admin_pages import importing, questionnaire
from surveys.definition import to_json
from surveys.document_forms.fields import language_name
from surveys.documents import spoken
from surveys.downloads import as_long_csv
from surveys.editor import views as editor
from surveys.forms import QuestionnaireForm
from surveys.importing.report import ImportReport
from surveys.models import Answer, Questionnaire, Response
from surveys.questionnaires import listed_title, named_by, problems_of, shipped_and_not_stored

NOTHING = "–"


@admin.register(Questionnaire)
class QuestionnaireAdmin(ShownFilters):
    form = QuestionnaireForm
    columns = ("slug", "version", "state", "languages", "questions", "response_count", "preview")
    list_display = ("listed", *columns)
    list_per_page = 50
    search_fields = ("title", "slug")
    named = ("title", "slug", "version", "state")
    about = (*named, "frozen_at", "source", "response_count", "preview")
    readonly_fields = (*about, "imported", "shown")
    change_list_template = "admin/surveys/questionnaire/change_list.html"

    def get_queryset(self, request: HttpRequest) -> QuerySet[Questionnaire]:
        return super().get_queryset(request).annotate(answered=Count("responses"))

    def changelist_view(self, request: HttpRequest, extra_context: Any = None) -> Any:
        """Also offer the questionnaires of the site; the editor no longer links back to a study."""
        request.session.pop(editor.OPENED_FROM, None)
        language = get_language() or ""
        listed = ((one, spoken(one.title, language)) for one in shipped_and_not_stored())
        built_in = [(one.slug, listed_title(one.slug, name), one.template) for one, name in listed]
        return super().changelist_view(request, {**(extra_context or {}), "built_in": built_in})

    def get_search_results(
        self, request: HttpRequest, queryset: QuerySet[Any], search_term: str
    ) -> tuple[QuerySet[Any], bool]:
        found, may_repeat = super().get_search_results(request, queryset, search_term)
        named = named_by(search_term) if search_term.strip() else []
        return found | queryset.filter(slug__in=named), may_repeat

    @admin.display(description=_("title"), ordering="title")
    def listed(self, row: Questionnaire) -> str:
        return listed_title(row.slug, row.title)

    def get_fieldsets(self, _request: HttpRequest, obj: Questionnaire | None = None) -> Any:
        if obj is None:
            return [(None, {"fields": ("file", "document")})]
        fields = ("file", "document") if obj.frozen_at is None else ("shown",)
        imported = [(_("Import"), {"fields": ("imported",), "classes": ["collapse"]})]
        definition = (_("Definition (JSON)"), {"fields": fields, "classes": ["collapse"]})
        about = (None, {"fields": self.about})
        return [about, *(imported if obj.import_report else []), definition]

    def has_change_permission(self, request: HttpRequest, obj: Questionnaire | None = None) -> bool:
        is_in_use = obj is not None and obj.frozen_at is not None
        return super().has_change_permission(request, obj) and not is_in_use

    def save_model(self, _request: HttpRequest, obj: Questionnaire, form: Any, _new: bool) -> None:
        for field in Questionnaire._meta.concrete_fields:
            setattr(obj, field.attname, getattr(form.stored, field.attname))
        obj._state.adding = False

    @admin.display(description=_("state"), ordering="frozen_at")
    def state(self, row: Questionnaire) -> str:
        if row.frozen_at is not None:
            return gettext("in use")
        if row.definition.get("template"):
            return gettext("template")
        return gettext("draft, incomplete") if problems_of(row) else gettext("draft")

    @admin.display(description=_("languages"))
    def languages(self, row: Questionnaire) -> str:
        return ", ".join(map(language_name, row.definition.get("languages", [])))

    @admin.display(description=_("questions"))
    def questions(self, row: Questionnaire) -> int:
        return len(row.as_definition().questions())

    @admin.display(description=_("responses"), ordering="answered")
    def response_count(self, row: Questionnaire) -> str:
        address = reverse("admin:surveys_response_changelist")
        link = '<a href="{}?questionnaire__id__exact={}">{}</a>'
        return format_html(link, address, row.pk, getattr(row, "answered", 0))

    @admin.display(description=_("preview"))
    def preview(self, row: Questionnaire) -> str:
        address = reverse("admin:surveys_questionnaire_preview", args=[row.pk])
        return format_html('<a href="{}">{}</a>', address, gettext("Preview"))

    @admin.display(description=_("source"))
    def source(self, row: Questionnaire) -> str:
        definition = row.as_definition()
        return " · ".join(filter(None, (definition.source, definition.licence))) or NOTHING

    @admin.display(description=_("definition"))
    def shown(self, row: Questionnaire) -> str:
        return format_html("<pre>{}</pre>", to_json(row.as_definition()).decode())

    @admin.display(description=_("import report"))
    def imported(self, row: Questionnaire) -> str:
        report = msgspec.convert(row.import_report, ImportReport)
        return render_to_string("admin/surveys/questionnaire/_report.html", {"report": report})

    def get_urls(self) -> list[URLPattern]:
        pages = chain(editor.PAGES, importing.PAGES, questionnaire.PAGES)
        own = [
            path(address, self.admin_site.admin_view(view), name=f"surveys_questionnaire_{name}")
            for address, view, name in pages
        ]
        return [*own, *super().get_urls()]


@admin.register(Response)
class ResponseAdmin(ShownFilters):
    """Responses, which can be deleted, because respondents have a right to it, but not edited."""

    asked_in = ("questionnaire", "context_label", "robots", "outcome")
    list_display = ("started_at", "who", *asked_in, "progress", "finished_at")
    list_filter = ("questionnaire", "outcome", "finished_at", "language")
    list_select_related = ("questionnaire", "user")
    user_fields = ("user__username", "user__display_name")
    search_fields = (*user_fields, "respondent_key", "context", "context_label")
    date_hierarchy = "started_at"
    list_per_page = 50
    actions = ("download_answers",)
    fields = (
        *("who", "questionnaire", "context_label", "context", "robots", "outcome", "seed"),
        *("language", "started_at", "seen_at", "finished_at", "answer_list"),
    )
    readonly_fields = ("who", "robots", "answer_list")

    def has_add_permission(self, _request: HttpRequest) -> bool:
        return False

    def has_change_permission(self, _request: HttpRequest, _obj: Model | None = None) -> bool:
        return False

    def change_view(
        self, request: HttpRequest, object_id: str, form_url: str = "", extra_context: Any = None
    ) -> HttpResponse:
        row = self.get_object(request, object_id) if self.has_view_permission(request) else None
        if row is not None:
            audit.note("answers_opened", actor=request.user, person=row.user_id, thing=row)
        return super().change_view(request, object_id, form_url, extra_context)

    @admin.display(description=_("respondent"), ordering="user__username")
    def who(self, response: Response) -> str:
        return response.user.shown_name if response.user is not None else response.respondent_key

    @admin.display(description=_("robot"))
    def robots(self, response: Response) -> str:
        return ", ".join(response.robot) or NOTHING

    @admin.display(description=_("pages done"), ordering="reached")
    def progress(self, response: Response) -> str:
        return f"{response.reached} / {len(response.questionnaire.definition.get('pages', []))}"

    @admin.display(description=_("answers"))
    def answer_list(self, response: Response) -> str:
        definition = response.questionnaire.as_definition()
        rows = {row.item: row for row in Answer.objects.filter(response=response)}
        given = {key: row.given for key, row in rows.items()}
        others = {"not_asked": gettext("not asked"), "not_reached": gettext("not reached")}
        reasons = {**dict(Answer.Reason.choices), **others}
        lines = []
        for key, status in response.response_statuses(definition, given).items():
            text = spoken(definition.by_key[key].text, response.language)
            missing = reasons.get(status.missing or "", "")
            about = {"text": text, "key": key, "value": status.value, "missing": missing}
            lines.append({**about, "row": rows.get(key)})
        return render_to_string("admin/surveys/response/_answers.html", {"lines": lines})

    @admin.action(description=_("Download answers (CSV)"), permissions=["view"])
    def download_answers(self, request: HttpRequest, queryset: QuerySet[Response]) -> Any:
        audit.note("answers_exported", actor=request.user, detail=f"{queryset.count()} responses")
        return as_long_csv(queryset, "answers")
