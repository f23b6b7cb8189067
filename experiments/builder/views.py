"""The study builder: a definition edited page by page, without JSON and without JavaScript. Mixed
into the studies' administration.

A page is a form over one place of the definition (experiments/builder/pages.py). Every button of it
sends the whole form: what was typed is kept with each part that is added, removed or moved. A draft
may be saved half done; what is still wrong stands above the form.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgspec
from django.contrib import messages
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect, JsonResponse
from django.shortcuts import render
from django.urls import URLPattern, path, reverse
from django.utils.translation import get_language, gettext_lazy
from django.utils.translation import gettext as _
from django.views.decorators.cache import never_cache

from experiments import publishing
from experiments.access import may
from experiments.builder.advice import advice
from experiments.builder.choices import (
    at_hand,
    offered,
    places,
    questionnaire_titles,
    speeds_refused,
)
from experiments.builder.course_ground import course_check, drawn_course
from experiments.builder.labels import GUIDE
from experiments.builder.pages import (
    INNER_LISTS,
    LISTS,
    PAGES,
    PLAN,
    BuilderPlace,
    by_factors,
    clicked_point,
    copied,
    middle_of,
    new_analysis,
    new_code,
    new_condition,
    new_course,
    new_factor,
    new_part,
    new_script_step,
    new_stage,
    new_step,
    parts_in,
    renumber,
    with_parts,
)
from experiments.builder.study_form import StudyPartForm
from experiments.builder.summaries import about, kinds, title_of
from experiments.definition.schema import Course, StudyDefinition
from experiments.definition.steps import KINDS
from experiments.models import Study as Row
from experiments.participation.steps import page_type
from experiments.research.study_access import study_for
from surveys.document_forms.parts import Document, change
from surveys.document_forms.problem_text import by_place, text_name
from surveys.document_forms.submitted import MEANWHILE, SubmittedPart, number, pressed
from surveys.documents import ChangedMeanwhileError, Problem
from surveys.editor.views import leads_here

TITLES = {
    "about": gettext_lazy("About the study"),
    "recruitment": gettext_lazy("Recruitment"),
    "steps": gettext_lazy("Steps"),
    "factors": gettext_lazy("Factors"),
    "conditions": gettext_lazy("Conditions"),
    "courses": gettext_lazy("Courses"),
    "analyses": gettext_lazy("Analyses"),
    PLAN: gettext_lazy("Plan"),
    "rules": gettext_lazy("Rules"),
    "wizard": gettext_lazy("Hidden operator"),
    "coding": gettext_lazy("Coding of replays"),
}
WALK_THROUGH = "walk_through"  # beside the sections: experiments/study_admin/walk_through.py
MOST_SHOWN = 40  # problems above a form


@dataclass(frozen=True)
class LinkedProblem:
    """A problem, and the page on which it is mended."""

    text: str
    url: str = ""


def whole_of(row: Row) -> Document:
    """Return the definition of a study as a plain document."""
    document: Document = msgspec.to_builtins(row.as_definition())
    return {**{name: [] for name in LISTS}, **document}


def address(row: Row, place: BuilderPlace) -> str:
    """Return the address of a page of the builder."""
    if place.index is None:
        page = INNER_LISTS.get(place.section, place.section)
        return reverse("admin:experiments_study_section", args=[row.pk, page])
    return reverse("admin:experiments_study_part", args=[row.pk, place.section, place.index])


def sections(row: Row) -> list[dict[str, Any]]:
    """Return the builder's sections as entries of a row of tabs, lists with their lengths; the last
    leads through the study as it is built.
    """
    walk = reverse("admin:experiments_study_walk_through", args=[row.pk])
    found = [
        {
            "key": name,
            "label": _title(name),
            "url": address(row, BuilderPlace(name)),
            "count": len(row.definition.get(name, ())) if name in LISTS else None,
        }
        for name in TITLES
    ]
    last = {"key": WALK_THROUGH, "label": _("Walk through"), "url": walk, "count": None}
    return [*found, last]


def told(row: Row) -> list[LinkedProblem]:
    """Return everything that is wrong with a study, or stands in its way here."""
    whole = whole_of(row)
    found = by_place(
        publishing.problems_of(row),
        lambda one: one.sentence(_),
        lambda one: _text_name(one, whole),
    )
    pages = {
        place: address(row, BuilderPlace(place.section, place.part)) if place.section else ""
        for place in found
    }
    return [LinkedProblem(text, pages[place]) for place, texts in found.items() for text in texts]


def _text_name(one: Problem, whole: Document) -> str:
    """Return what a text that is missing is called, with the part of the study that it is in."""
    part = BuilderPlace(one.place.section, one.place.part).part(whole)
    title = [title_of(part, whole)] if part is not None and part is not whole else []
    name = text_name(
        GUIDE, part, one.path, lambda inner: title_of(inner, whole) if "key" in inner else ""
    )
    return " · ".join([*title, name])


class BuilderPages:
    """The pages of the builder."""

    def builder_urls(self) -> list[URLPattern]:
        """Return their addresses."""
        guard = self.admin_site.admin_view  # type: ignore[attr-defined]
        start = "<uuid:pk>/build/<slug:section>/"
        return [
            path(start, guard(never_cache(self.section_view)), name="experiments_study_section"),
            path(
                f"{start}<int:index>/",
                guard(never_cache(self.part_view)),
                name="experiments_study_part",
            ),
            path(
                f"{start}<int:index>/check/",
                guard(never_cache(self.check_view)),
                name="experiments_study_check",
            ),
        ]

    def section_view(self, request: HttpRequest, pk: Any, section: str) -> HttpResponse:
        """Show a page of the study's own fields, or a list of its parts; a POST changes them."""
        row = study_for(request, pk, "viewer")
        if section in PAGES or section == PLAN:
            return self._form(request, row, BuilderPlace(section))
        if section not in LISTS and section not in INNER_LISTS:
            raise Http404
        if request.method == "POST":
            return self._change_list(request, _to_change(request, row), section)
        if section in INNER_LISTS:
            return HttpResponseRedirect(address(row, BuilderPlace(section)))
        return self._render(
            request,
            row,
            "list",
            section,
            {"parts": list(_listed(row, section)), "kinds": kinds(section)},
        )

    def part_view(self, request: HttpRequest, pk: Any, section: str, index: int) -> HttpResponse:
        """Show one step, condition or course; a POST changes it."""
        return self._form(request, study_for(request, pk, "viewer"), BuilderPlace(section, index))

    def check_view(self, request: HttpRequest, pk: Any, section: str, index: int) -> JsonResponse:
        """Tell what stands in the way of a course as it is on the page, saved or not."""
        row, place = study_for(request, pk, "viewer"), BuilderPlace(section, index)
        whole = whole_of(row)
        part = place.part(whole)
        if request.method != "POST" or section != "courses" or part is None:
            raise Http404
        draft = _read(request, place, part)
        if draft.errors:
            return JsonResponse(
                {"problems": list(dict.fromkeys(draft.errors.values())), "checkpoints": []}
            )
        study = msgspec.convert(place.put(whole, draft.part), StudyDefinition)
        return JsonResponse(course_check(study, index))

    # --- forms ------------------------------------------------------------------------------------

    def _form(self, request: HttpRequest, row: Row, place: BuilderPlace) -> HttpResponse:
        whole = whole_of(row)
        part = place.part(whole)
        if part is None:
            raise Http404
        if request.method != "POST":
            return self._show(request, row, place, SubmittedPart(part))
        _to_change(request, row)
        draft = _read(request, place, part)
        saved = None if draft.errors else _save(request, row, place, draft)
        if saved is None:
            return self._show(request, Row.objects.get(pk=row.pk), place, draft, status=422)
        publishing.log(
            saved,
            request.user,
            f"Changed: {place.section}{'' if place.index is None else f' {place.index + 1}'}.",
        )
        messages.success(request, _("Saved."))
        return HttpResponseRedirect(
            address(row, place) + (f"#{draft.anchor}" if draft.anchor else "")
        )

    def _show(
        self,
        request: HttpRequest,
        row: Row,
        place: BuilderPlace,
        draft: SubmittedPart,
        status: int = 200,
    ) -> HttpResponse:
        whole, part = whole_of(row), draft.part
        former = place.part(whole) or part
        cls = place.cls(former)
        form = StudyPartForm(
            cls,
            part,
            languages=whole["languages"],
            offered=offered(whole, part),
            only=place.only,
            is_sent=bool(draft.errors),
            decided=("Allocation.design",) if whole["factors"] else (),
        )
        for name in draft.errors.keys() & form.fields.keys() - form.errors.keys():
            form.add_error(name, draft.errors[name])
        if "questionnaire" in former:
            leads_here(request, row.shown_title, address(row, place))
        language = get_language() or ""
        advised = advice(row.as_definition(), place, language)
        context = {
            "advice": [LinkedProblem(text, address(row, other)) for text, other in advised],
            "form": form,
            "place": place,
            "above": draft.above,
            "has_errors": bool(draft.errors),
            "part_title": title_of(former, whole) if place.index is not None else "",
            "kind": page_type(former["kind"]).label if place.section == "steps" else "",
            "told": page_type(former["kind"]).told if place.section == "steps" else "",
            "walked": former["key"] if place.section == "steps" else "",
        }
        inner = next((one for one, page in INNER_LISTS.items() if page == place.section), None)
        if inner is not None and whole.get(place.section) is not None:
            context |= {
                "list_title": GUIDE.label(inner),
                "list_address": reverse("admin:experiments_study_section", args=[row.pk, inner]),
                "parts": list(_listed(row, inner)),
                "kinds": kinds(inner),
            }
        if place.section == "courses":
            context |= {
                "course": drawn_course(part),
                "check": reverse(
                    "admin:experiments_study_check", args=[row.pk, "courses", place.index]
                ),
            }
        return self._render(
            request,
            row,
            "course" if place.section == "courses" else "part",
            place.section,
            context,
            place=place,
            status=status,
        )

    def _render(
        self,
        request: HttpRequest,
        row: Row,
        page: str,
        section: str,
        more: Document,
        *,
        place: BuilderPlace | None = None,
        status: int = 200,
    ) -> HttpResponse:
        found = told(row)
        mine = [one for one in found if place is None or one.url == address(row, place)]
        context = (
            self.admin_site.each_context(request)
            | {  # type: ignore[attr-defined]
                "title": _title(INNER_LISTS.get(section, section)),
                "opts": self.opts,
                "study": row,
                "study_tab": "builder",
                "section": INNER_LISTS.get(section, section),  # type: ignore[attr-defined]
                "sections": sections(row),
                "problems": mine[:MOST_SHOWN],
                "elsewhere": len(found) - len(mine),
                "may_change": _may_change(request, row),
                "pilots": row.participants.count(),
            }
        )
        return render(
            request, f"admin/experiments/study/builder_{page}.html", context | more, status=status
        )

    # --- lists ------------------------------------------------------------------------------------

    def _change_list(self, request: HttpRequest, row: Row, section: str) -> HttpResponse:
        verb, what = pressed(request.POST, 2)
        whole = whole_of(row)
        parts = changed = parts_in(whole, section)
        if verb == "add":
            changed = [*parts, _new(section, what, whole)]
        else:
            n = number(what)
            changed = change(parts, verb, n)
            if verb == "copy" and len(changed) > len(parts):
                changed[n + 1] = copied(section, parts[n], whole)
        whole = with_parts(whole, section, changed)
        saved = _keep(row, whole) if request.POST.get("sha256") == row.sha256 else str(MEANWHILE)
        if isinstance(saved, str):
            messages.error(request, saved)
        elif verb == "add":
            return HttpResponseRedirect(address(row, BuilderPlace(section, len(parts))))
        return HttpResponseRedirect(address(row, BuilderPlace(section)))


def _title(section: str) -> str:
    return str(TITLES[section])


def _may_change(request: HttpRequest, row: Row) -> bool:
    return row.status == Row.Status.DRAFT and may(request.user, row.slug, "owner")


def _to_change(request: HttpRequest, row: Row) -> Row:
    """Return the row when it may be changed; for whoever may not, a page that changes it is not
    there.
    """
    if not _may_change(request, row):
        raise Http404
    return row


def _read(request: HttpRequest, place: BuilderPlace, former: Document) -> SubmittedPart:
    """Return what a form says after its button: `save`, `add:<list>`, or
    `remove|up|down:<list>:<n>`.
    """
    cls = place.cls(former)
    part = StudyPartForm.read(cls, request.POST, only=place.only)
    anchor = _press(part, request.POST)
    if cls is Course:
        part = renumber(part)
    told = StudyPartForm(cls, part, only=place.only, is_sent=True).told
    if place.section == "conditions" and not told:
        told = speeds_refused(part)
    return SubmittedPart(part, told, anchor=anchor)


def _press(part: Document, sent: Any) -> str:
    """Do what the button of a form says to one of the lists in it, and return where the page goes
    on.
    """
    verb, key, n = pressed(sent)
    if key == "balance":  # of all lists the one that is deeper inside
        part = part.setdefault("allocation", {})
    values = part.get(key, [])
    if verb == "add" and key == "steps":
        step = new_script_step(part, n, places(publishing.sites().values()))
        part[key] = [*values, step] if step else values
        return f"{key}.{len(values)}"
    if verb == "add" and key in GUIDE.items:
        middle = middle_of(publishing.sites().get(part.get("site", "")))
        at = clicked_point(sent.get("at", ""), middle)
        part[key] = [*values, new_part(key, len(values), at)]
        return "course" if sent.get("at") else f"{key}.{len(values)}"
    if isinstance(part.get(key), list):
        part[key] = change(values, verb, number(n))
    return key


def _save(request: HttpRequest, row: Row, place: BuilderPlace, draft: SubmittedPart) -> Row | None:
    """Keep what a form says; None with the reason in the draft when that cannot be."""
    if request.POST.get("sha256") != row.sha256:
        draft.above.append(str(MEANWHILE))
        return None
    kept = _keep(row, place.put(whole_of(row), draft.part))
    if isinstance(kept, str):
        draft.above.append(kept)
        return None
    return kept


def _keep(row: Row, whole: Document) -> Row | str:
    try:
        return publishing.save_draft(row, msgspec.convert(by_factors(whole), StudyDefinition))
    except msgspec.ValidationError as error:
        return f"{error}."
    except ChangedMeanwhileError:
        return _("Not saved: someone changed or published this study at the same time. Try again.")


# --- what is shown --------------------------------------------------------------------------------


def _listed(row: Row, section: str) -> Iterator[dict[str, Any]]:
    whole, titles = whole_of(row), questionnaire_titles() if section == "steps" else {}
    for n, part in enumerate(parts_in(whole, section)):
        yield {
            "url": address(row, BuilderPlace(section, n)),
            "n": n,
            "title": title_of(part, whole),
            "about": list(about(section, part, whole, titles)),
        }


def _new(section: str, kind: str, whole: Document) -> Document:
    if section == "steps":
        if kind not in KINDS:
            raise Http404
        return new_step(kind, page_type(kind).blank, whole)
    blank = {
        "factors": new_factor,
        "analyses": new_analysis,
        "stages": new_stage,
        "codes": new_code,
    }
    if section in blank:
        return blank[section](whole)
    return (
        new_condition(whole, at_hand()) if section == "conditions" else new_course(whole, at_hand())
    )
