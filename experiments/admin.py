"""Studies in the administration: building, rehearsing, publishing, and links to their results."""

from collections.abc import Callable
from functools import partial
from typing import Any

from django.contrib import admin, messages
from django.db.models import Count, Max, Model, Q, QuerySet
from django.forms import ModelForm
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import redirect
from django.urls import URLPattern, path, reverse
from django.utils import timezone
from django.utils.html import format_html, format_html_join
from django.utils.safestring import SafeString
from django.utils.translation import gettext, gettext_lazy as _
from django.views.decorators.http import require_POST, require_safe

from accounts import audit
from experiments import publishing
from experiments.access import may
from experiments.builder.forms import CopyForm, PublishForm, StudyForm
from experiments.builder.labels import ENDING_NAMES
from experiments.builder.views import BuilderPages, linked_doubts, linked_problems, sections
from experiments.definition.schema import to_json
from experiments.definition.shipped import shipped
from experiments.models import Participant, ParticipantKind, Study, StudyMember
from experiments.participation import completion
from experiments.research.notices import mail_to_owner
from experiments.research.study_access import shown_time
from experiments.study_admin import opening_hours
from experiments.study_admin.drives import DriveAdmin
from experiments.study_admin.participants import ParticipantAdmin
from experiments.study_admin.people import PeoplePages, made
from experiments.study_admin.plan import PlanPages
from experiments.study_admin.publication import PublicationPages
from experiments.study_admin.recruitment import RecruitmentPages
from experiments.study_admin.rehearsals import RehearsalAdmin, offer_of
from experiments.study_admin.rows import OfStudies
from experiments.study_admin.walk_through import WalkThroughPages
from robots.admin_pages.overview import register_section
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError

SETTINGS = ("entry", "exclusive")  # that published studies also change
register_section("mail", mail_to_owner)


def _count_of(kind: ParticipantKind, title: Any) -> Callable[[Any, Study], SafeString]:
    """Return a column with the number of participants of a kind, linked to their list."""

    @admin.display(description=title, ordering=f"n_{kind}")
    def count(_admin: Any, row: Study) -> SafeString:
        address = reverse("admin:experiments_participant_changelist")
        query = f"?study={row.pk}&kind__exact={kind}"
        return format_html('<a href="{}{}">{}</a>', address, query, getattr(row, f"n_{kind}", 0))

    return count


@admin.register(Study)
class StudyAdmin(
    BuilderPages,
    PeoplePages,
    PlanPages,
    PublicationPages,
    RecruitmentPages,
    WalkThroughPages,
    OfStudies,
):
    form = StudyForm
    list_display = (
        *("title", "name_and_version", "status", "people", "pilots", "bots"),
        *("last_activity", "links"),
    )
    list_filter = ("status",)
    list_per_page = 50
    search_fields = ("title", "slug")
    change_list_template = "admin/experiments/study/change_list.html"
    change_form_template = "admin/experiments/study/change_form.html"

    def has_add_permission(self, request: HttpRequest) -> bool:
        """Users with the permission, and owners of a study, who create new versions."""
        user: Any = request.user
        is_owner = StudyMember.objects.filter(user=user, role=StudyMember.Role.OWNER).exists()
        return bool(user.is_staff and (user.has_perm("experiments.add_study") or is_owner))

    def has_change_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Owners change the entry and the definition of a draft."""
        if obj is None:
            return self.has_module_permission(request)
        return may(request.user, self.slug_of(obj), "owner")

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Owners delete drafts without participants, one at a time: no action in the list."""
        is_owner = isinstance(obj, Study) and may(request.user, obj.slug, "owner")
        return is_owner and publishing.may_delete(obj)

    def get_queryset(self, request: HttpRequest) -> "QuerySet[Study]":
        rows = super().get_queryset(request).annotate(active_at=Max("participants__seen_at"))
        of_kind = {f"n_{kind}": Q(participants__kind=kind) for kind in ParticipantKind}
        return rows.annotate(**{n: Count("participants", filter=q) for n, q in of_kind.items()})

    @admin.display(description=_("name"), ordering="slug")
    def name_and_version(self, row: Study) -> str:
        return f"{row.slug} {row.version}"

    people = _count_of(ParticipantKind.PARTICIPANT, _("participants"))
    pilots = _count_of(ParticipantKind.PILOT, _("pilots"))
    bots = _count_of(ParticipantKind.BOT, _("bots"))

    @admin.display(description=_("last activity"), ordering="active_at")
    def last_activity(self, row: Study) -> str:
        return shown_time(getattr(row, "active_at", None))

    @admin.display(description="")
    def links(self, row: Study) -> SafeString:
        drives = reverse("admin:experiments_drive_changelist") + f"?study={row.pk}"
        live = reverse("study_live", args=[row.slug])
        analysis = reverse("study_analysis", args=[row.pk])
        links = ((drives, _("Drives")), (live, _("Live")), (analysis, _("Analysis")))
        return format_html_join(" · ", '<a href="{}">{}</a>', links)

    def get_fieldsets(self, request: HttpRequest, obj: Study | None = None) -> list[Any]:
        """A new study starts empty or from a file; a draft can be replaced by a file."""
        file = {"fields": ("file", "document")}
        if obj is None:
            empty = (_("Start an empty study"), {"fields": ("name", "called", "spoken")})
            return [empty, (_("or import one from a file"), file)]
        settings = (_("How people join"), {"fields": SETTINGS})
        if obj.status != Study.Status.DRAFT or not self.has_change_permission(request, obj):
            return [settings]
        replaced = _("Replace the definition with a file")
        return [settings, (replaced, file | {"classes": ("collapse",)})]

    def get_form(
        self, request: HttpRequest, obj: Study | None = None, change: bool = False, **kwargs: Any
    ) -> Any:
        form = super().get_form(request, obj, change=change, **kwargs)
        return type("StudyFormOf", (form,), {"user": request.user})

    def save_model(self, request: HttpRequest, obj: Study, form: ModelForm, change: bool) -> None:
        if form.stored is not None:
            kept = {name: getattr(obj, name) for name in SETTINGS} if change else {}
            for field in Study._meta.concrete_fields:
                value = kept.get(field.name, getattr(form.stored, field.attname))
                setattr(obj, field.attname, value)
            obj._state.adding = False
            publishing.own(obj, request.user)
        if change:
            rows = Study.objects.filter(pk=obj.pk)
            rows.update(**{name: getattr(obj, name) for name in SETTINGS})
            changed = " ".join(form.changed_data)
            audit.note("study_changed", actor=request.user, study=obj.slug, detail=changed)

    def response_add(self, request: HttpRequest, obj: Study, *_more: Any) -> HttpResponse:
        messages.success(request, gettext("Study %(study)s created as a draft.") % {"study": obj})
        return HttpResponseRedirect(reverse("admin:experiments_study_change", args=[obj.pk]))

    def change_view(
        self, request: HttpRequest, object_id: str, form_url: str = "", extra_context: Any = None
    ) -> HttpResponse:
        row = self.get_object(request, object_id)
        more = self._overview(request, row) if row is not None else {}
        more["show_save_and_add_another"] = False
        return super().change_view(request, object_id, form_url, {**(extra_context or {}), **more})

    def _overview(self, request: HttpRequest, row: Study) -> dict[str, Any]:
        people = Participant.objects.filter(study=row, kind=ParticipantKind.PARTICIPANT).order_by()
        by_status = dict(people.values_list("status").annotate(n=Count("pk")))
        codes, statuses = completion.codes(row).items(), Participant.Status.choices
        return {
            "study": row,
            "study_tab": "overview",
            "problems": linked_problems(row),
            "doubts": linked_doubts(row) if row.status == Study.Status.DRAFT else [],
            "is_owner": may(request.user, row.slug, "owner"),
            "may_research": may(request.user, row.slug, "researcher"),
            "sections": sections(row),
            "codes": [(ENDING_NAMES[ending], code) for ending, code in codes],
            "share": request.build_absolute_uri(reverse("study", args=[row.slug])),
            "rehearsal": publishing.passed_rehearsal(row),
            "offer": offer_of(row),
            "statuses": [(words, by_status.get(value, 0)) for value, words in statuses],
            "hours": opening_hours.summary(row.opening_hours, row.time_zone),
            "title": gettext("Study"),
        }

    def get_urls(self) -> list[URLPattern]:
        shipped = self.admin_site.admin_view(require_POST(self.take_shipped))
        change = require_POST(self.close_or_reopen)
        return [
            path("shipped/", shipped, name="experiments_study_shipped"),
            self.study_path("export.json", require_safe(self.export), "export"),
            self.study_path("new-version/", require_POST(self.new_version), "new_version", "owner"),
            self.study_path("copy/", self.copy_view, "copy", "owner"),
            self.study_path("publish/", self.publish_view, "publish", "owner"),
            self.study_path("close/", partial(change, is_closing=True), "close", "owner"),
            self.study_path("reopen/", partial(change, is_closing=False), "reopen", "owner"),
            *self.study_urls(),
            *super().get_urls(),
        ]

    def changelist_view(self, request: HttpRequest, extra_context: Any = None) -> HttpResponse:
        user: Any = request.user
        known = set(Study.objects.values_list("slug", flat=True))
        new = {slug: one.title.get("en", slug) for slug, one in shipped().items()}
        offered = [(slug, title) for slug, title in new.items() if slug not in known]
        more = {"shipped": offered if user.has_perm("experiments.add_study") else []}
        return super().changelist_view(request, {**(extra_context or {}), **more})

    def take_shipped(self, request: HttpRequest) -> HttpResponse:
        user: Any = request.user
        definition = shipped().get(request.POST.get("study", ""))
        if definition is None or not user.has_perm("experiments.add_study"):
            raise Http404
        if Study.objects.filter(slug=definition.slug).exists():
            messages.info(request, made(0))
            return redirect("admin:experiments_study_changelist")
        row = publishing.store(definition, timezone.now())
        publishing.own(row, user)
        self.log_addition(request, row, "Taken from those that come with the site.")
        messages.success(request, made(1))
        return redirect("admin:experiments_study_change", row.pk)

    def export(self, _request: HttpRequest, row: Study) -> HttpResponse:
        headers = {"Content-Disposition": f'attachment; filename="{row.slug}-{row.version}.json"'}
        content = to_json(row.as_definition())
        return HttpResponse(content, content_type="application/json", headers=headers)

    def new_version(self, request: HttpRequest, row: Study) -> HttpResponse:
        copy = publishing.new_version(row, timezone.now())
        self.log_addition(request, copy, "New version.")
        words = gettext("Version %(n)d is a draft. Edit it, rehearse it, then publish it.")
        messages.success(request, words % {"n": copy.version})
        return redirect("admin:experiments_study_change", copy.pk)

    def copy_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        form = CopyForm(request.POST or None, initial={"title": row.shown_title})
        if request.method == "POST" and form.is_valid():
            name, title = form.cleaned_data["name"], form.cleaned_data["title"]
            try:
                made = publishing.copy(row, name, title, timezone.now())
            except BadDefinitionError as error:
                form.add_error("name", sentences(error.problems))
            else:
                publishing.own(made, request.user)
                self.log_addition(request, made, f"Copied from {row.slug} {row.version}.")
                return redirect("admin:experiments_study_change", made.pk)
        title = gettext("Copy as a new study")
        return self.study_page(request, row, "copy", title, {"form": form}, tab="overview")

    def publish_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        form, reasons = PublishForm(request.POST if request.method == "POST" else None), []
        if request.method == "POST" and form.is_valid():
            reason, is_confirmed = form.cleaned_data["reason"], form.cleaned_data["confirmed"]
            now = timezone.now()
            try:
                publishing.publish(row, request.user, reason, now, is_confirmed=is_confirmed)
            except publishing.NotPublishableError as error:
                known = publishing.problems_of(row)  # already on the page
                reasons = sentences(one for one in error.reasons if one not in known)
            else:
                words = gettext("Study published. Its definition can no longer be changed.")
                messages.success(request, words)
                return redirect("admin:experiments_study_change", row.pk)
        context = {"form": form, "reasons": reasons, "is_owner": True, "offer": offer_of(row)}
        context |= {"problems": linked_problems(row), "doubts": linked_doubts(row)}
        context["rehearsal"] = publishing.passed_rehearsal(row)
        about: dict[str, Any] = {
            "tab": "overview",
            "status": 422 if request.method == "POST" else 200,
        }
        return self.study_page(request, row, "publish", gettext("Publish"), context, **about)

    def close_or_reopen(self, request: HttpRequest, row: Study, *, is_closing: bool) -> Any:
        try:
            if is_closing:
                publishing.close(row, timezone.now())
                words = gettext("Study closed: it accepts no new participants.")
            else:
                publishing.reopen(row)
                words = gettext("Study reopened: it accepts participants again.")
        except publishing.NotPublishableError as error:
            messages.error(request, " ".join(sentences(error.reasons)))
        else:
            event = "study_closed" if is_closing else "study_opened"
            publishing.log(row, request.user, "Closed." if is_closing else "Opened again.")
            audit.note(event, actor=request.user, study=row.slug, detail=f"version {row.version}")
            messages.success(request, words)
        return redirect("admin:experiments_study_change", row.pk)


# all that is registered here
__all__ = ["DriveAdmin", "ParticipantAdmin", "RehearsalAdmin", "StudyAdmin"]
