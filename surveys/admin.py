"""Questionnaires and responses in the administration: to import, look at, and download; answers are
never edited.
"""

from typing import Any

from django.contrib import admin
from django.db.models import Count, Model, QuerySet
from django.forms import ModelForm
from django.http import HttpRequest, HttpResponse, StreamingHttpResponse
from django.template.loader import render_to_string
from django.urls import URLPattern, path, reverse
from django.utils.html import format_html
from django.utils.safestring import SafeString
from django.utils.translation import get_language, gettext
from django.utils.translation import gettext_lazy as _

from accounts import audit
from accounts.admin_filters import ShownFilters
from surveys.admin_pages import importing, questionnaire
from surveys.definition import to_json
from surveys.document_forms.fields import language_name
from surveys.documents import spoken
from surveys.downloads import as_long_csv
from surveys.editor import views as editor
from surveys.forms import QuestionnaireForm
from surveys.importing.report import from_stored
from surveys.models import Answer, Questionnaire, Response
from surveys.questionnaires import listed_title, named_by, problems_of, shipped

NOTHING = "–"


@admin.register(Questionnaire)
class QuestionnaireAdmin(ShownFilters):
    """Questionnaires by version. A version that somebody answered stays as it is."""

    form = QuestionnaireForm
    list_display = (
        "listed",
        "slug",
        "version",
        "state",
        "languages",
        "questions",
        "response_count",
        "preview",
    )
    list_per_page = 50
    search_fields = ("title", "slug")
    about = (
        *("title", "slug", "version", "state"),
        *("frozen_at", "source", "response_count", "preview"),
    )
    readonly_fields = (*about, "imported", "shown")
    change_list_template = "admin/surveys/questionnaire/change_list.html"

    def get_queryset(self, request: HttpRequest) -> QuerySet[Questionnaire]:
        """Count the responses in the same query."""
        return super().get_queryset(request).annotate(answered=Count("responses"))

    def changelist_view(self, request: HttpRequest, extra_context: Any = None) -> Any:
        """Show the list, and offer what comes with the site; who comes by it to the editor was not
        led there by a study.
        """
        request.session.pop(editor.OPENED_FROM, None)
        known = set(Questionnaire.objects.values_list("slug", "version"))
        language = get_language() or ""
        built_in = [
            (slug, listed_title(slug, spoken(one.title, language)), one.template)
            for slug, one in shipped().items()
            if (slug, one.version) not in known
        ]
        return super().changelist_view(request, {**(extra_context or {}), "built_in": built_in})

    def get_search_results(
        self, request: HttpRequest, queryset: QuerySet[Any], search_term: str
    ) -> tuple[QuerySet[Any], bool]:
        """Find instruments also by the name that researchers know."""
        found, may_repeat = super().get_search_results(request, queryset, search_term)
        named = named_by(search_term) if search_term.strip() else []
        return found | queryset.filter(slug__in=named), may_repeat

    @admin.display(description=_("title"), ordering="title")
    def listed(self, row: Questionnaire) -> str:
        """What it is called, with the name of its instrument."""
        return listed_title(row.slug, row.title)

    def get_fieldsets(
        self, _request: HttpRequest, obj: Questionnaire | None = None
    ) -> list[tuple[Any, dict[str, Any]]]:
        """A new one is a file; one that is in use can only be looked at."""
        if obj is None:
            return [(None, {"fields": ("file", "document")})]
        fields = ("file", "document") if obj.frozen_at is None else ("shown",)
        imported = [(_("Import"), {"fields": ("imported",), "classes": ["collapse"]})]
        return [
            (None, {"fields": self.about}),
            *(imported if obj.import_report else []),
            (_("Definition (JSON)"), {"fields": fields, "classes": ["collapse"]}),
        ]

    def has_change_permission(self, request: HttpRequest, obj: Questionnaire | None = None) -> bool:
        """What is in use never changes."""
        return super().has_change_permission(request, obj) and (
            obj is None or obj.frozen_at is None
        )

    def save_model(
        self, _request: HttpRequest, obj: Questionnaire, form: ModelForm, _change: bool
    ) -> None:
        """Show the row that the form has stored."""
        stored = form.stored
        for field in Questionnaire._meta.concrete_fields:
            setattr(obj, field.attname, getattr(stored, field.attname))
        obj._state.adding = False

    @admin.display(description=_("state"), ordering="frozen_at")
    def state(self, row: Questionnaire) -> str:
        """Template, draft, complete or not, or in use."""
        if row.frozen_at is not None:
            return gettext("in use")
        if row.definition.get("template"):
            return gettext("template")
        return gettext("draft, incomplete") if problems_of(row) else gettext("draft")

    @admin.display(description=_("languages"))
    def languages(self, row: Questionnaire) -> str:
        """In which it can be answered."""
        return ", ".join(map(language_name, row.definition.get("languages", [])))

    @admin.display(description=_("questions"))
    def questions(self, row: Questionnaire) -> int:
        """How many it asks."""
        return sum(1 for _question in row.as_definition().questions())

    @admin.display(description=_("responses"), ordering="answered")
    def response_count(self, row: Questionnaire) -> str | SafeString:
        """How many began to answer it, with a link to them."""
        address = reverse("admin:surveys_response_changelist")
        return format_html(
            '<a href="{}?questionnaire__id__exact={}">{}</a>',
            address,
            row.pk,
            getattr(row, "answered", 0),
        )

    @admin.display(description=_("preview"))
    def preview(self, row: Questionnaire) -> SafeString:
        """The way to its pages, as respondents see them."""
        return format_html(
            '<a href="{}">{}</a>',
            reverse("admin:surveys_questionnaire_preview", args=[row.pk]),
            gettext("Preview"),
        )

    @admin.display(description=_("source"))
    def source(self, row: Questionnaire) -> str:
        """Where it comes from, and who may use it."""
        definition = row.as_definition()
        return (
            " · ".join(text for text in (definition.source, definition.licence) if text) or NOTHING
        )

    @admin.display(description=_("definition"))
    def shown(self, row: Questionnaire) -> SafeString:
        """The definition as JSON."""
        return format_html("<pre>{}</pre>", to_json(row.as_definition()).decode())

    @admin.display(description=_("import report"))
    def imported(self, row: Questionnaire) -> SafeString:
        """What became of each part of the file that it was imported from."""
        report = from_stored(row.import_report)
        return render_to_string("admin/surveys/questionnaire/_report.html", {"report": report})

    def get_urls(self) -> list[URLPattern]:
        """The pages of the model, and its own."""
        guard = self.admin_site.admin_view
        own = [
            *editor.urls(guard),
            path("import/", guard(importing.choose), name="surveys_questionnaire_import"),
            path("import/save/", guard(importing.save), name="surveys_questionnaire_import_save"),
            path(
                "shipped/", guard(questionnaire.take_shipped), name="surveys_questionnaire_shipped"
            ),
            path(
                "<uuid:pk>/preview/",
                guard(questionnaire.preview),
                name="surveys_questionnaire_preview",
            ),
            path(
                "<uuid:pk>/export.json",
                guard(questionnaire.export),
                name="surveys_questionnaire_export",
            ),
            path(
                "<uuid:pk>/answers-<str:shape>.csv",
                guard(questionnaire.answers),
                name="surveys_questionnaire_answers",
            ),
            path(
                "<uuid:pk>/new-version/",
                guard(questionnaire.new_version),
                name="surveys_questionnaire_new_version",
            ),
        ]
        return [*own, *super().get_urls()]


@admin.register(Response)
class ResponseAdmin(ShownFilters):
    """Who answered what. Nothing is edited; a response can be deleted, because respondents have a
    right to it.
    """

    list_display = (
        "started_at",
        "who",
        "questionnaire",
        "context_label",
        "robots",
        "outcome",
        "progress",
        "finished_at",
    )
    list_filter = ("questionnaire", "outcome", "finished_at", "language")
    list_select_related = ("questionnaire", "user")
    search_fields = (
        "user__username",
        "user__display_name",
        "respondent_key",
        "context",
        "context_label",
    )
    date_hierarchy = "started_at"
    list_per_page = 50
    actions = ("download_answers",)
    fields = (
        "who",
        "questionnaire",
        "context_label",
        "context",
        "robots",
        "outcome",
        "seed",
        "language",
        "started_at",
        "seen_at",
        "finished_at",
        "told",
    )
    readonly_fields = ("who", "robots", "told")

    def has_add_permission(self, _request: HttpRequest) -> bool:
        """Nobody answers for others."""
        return False

    def has_change_permission(self, _request: HttpRequest, _obj: Model | None = None) -> bool:
        """Nor changes what they said."""
        return False

    def change_view(
        self, request: HttpRequest, object_id: str, form_url: str = "", extra_context: Any = None
    ) -> HttpResponse:
        """Note who was shown whose answers."""
        row = self.get_object(request, object_id) if self.has_view_permission(request) else None
        if row is not None:
            audit.note("answers_opened", actor=request.user, person=row.user_id, thing=row)
        return super().change_view(request, object_id, form_url, extra_context)

    @admin.display(description=_("respondent"), ordering="user__username")
    def who(self, response: Response) -> str:
        """A user's shown name, or the anonymous key."""
        return response.user.shown_name if response.user is not None else response.respondent_key

    @admin.display(description=_("robot"))
    def robots(self, response: Response) -> str:
        """The words by which the robot goes."""
        return ", ".join(response.robot) or NOTHING

    @admin.display(description=_("pages done"), ordering="reached")
    def progress(self, response: Response) -> str:
        """How far they came."""
        return f"{response.reached} / {len(response.questionnaire.definition.get('pages', []))}"

    @admin.display(description=_("answers"))
    def told(self, response: Response) -> SafeString:
        """Every question, and what was said."""
        definition = response.questionnaire.as_definition()
        rows = {row.item: row for row in Answer.objects.filter(response=response)}
        response_statuses = response.response_statuses(
            definition, {key: row.given for key, row in rows.items()}
        )
        reasons = {
            **dict(Answer.Reason.choices),
            "not_asked": gettext("not asked"),
            "not_reached": gettext("not reached"),
        }
        lines = [
            {
                "text": spoken(question.text, response.language),
                "key": question.key,
                "value": response_statuses[question.key].value,
                "missing": reasons.get(response_statuses[question.key].missing or "", ""),
                "row": rows.get(question.key),
            }
            for question in definition.questions()
        ]
        return render_to_string("admin/surveys/response/_answers.html", {"lines": lines})

    @admin.action(description=_("Download answers (CSV)"), permissions=["view"])
    def download_answers(
        self, request: HttpRequest, queryset: QuerySet[Response]
    ) -> StreamingHttpResponse:
        """A line a question and response."""
        audit.note("answers_exported", actor=request.user, detail=f"{queryset.count()} responses")
        return as_long_csv(queryset, "answers")
