"""The study builder: a definition edited page by page, without JSON and without JavaScript. Mixed
into the studies' administration.

A page is a form over one place of the definition (experiments/builder/pages.py). Every button of it
sends the whole form: what was typed is kept with each part that is added, removed or moved. A draft
may be saved half done; what is still wrong is listed above the form.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import msgspec
from django.contrib import messages
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect, JsonResponse
from django.urls import URLPattern, reverse
from django.utils import timezone
from django.utils.translation import get_language, gettext_lazy
from django.utils.translation import gettext as _

from experiments import instruction_media, publishing
from experiments.access import may
from experiments.builder.advice import advice
from experiments.builder.arrangement import Renamed, arranged, renamed
from experiments.builder.choices import (
    at_hand,
    offered,
    places,
    questionnaire_titles,
    speeds_refused,
    write_claims,
    write_contrasts,
)
from experiments.builder.course_ground import course_check, drawn_course
from experiments.builder.design import (
    complete,
    design_table,
    renaming,
    restore,
    set_by_levels,
)
from experiments.builder.labels import GUIDE
from experiments.builder.pages import (
    DESIGN,
    INNER_LISTS,
    LISTS,
    PAGES,
    PLAN,
    BuilderPlace,
    clicked_point,
    copied,
    landing,
    list_in,
    middle_of,
    new_analysis,
    new_code,
    new_condition,
    new_course,
    new_part,
    new_script_step,
    new_stage,
    new_step,
    parts_in,
    renumber,
    with_courses,
    with_parts,
)
from experiments.builder.study_form import StudyPartForm
from experiments.builder.study_page import StudyPages
from experiments.builder.summaries import about, kinds, title_of
from experiments.definition.problems import doubts
from experiments.definition.schema import Condition, StudyDefinition
from experiments.definition.steps import KINDS
from experiments.models import Study as Row
from experiments.participation.steps import page_type
from experiments.research.study_access import study_for
from surveys.document_forms.part_form import MEANWHILE, SubmittedPart, number, pressed
from surveys.document_forms.parts import Document, change
from surveys.document_forms.problem_text import by_place, text_name
from surveys.documents import ChangedMeanwhileError, Problem
from surveys.editor.views import leads_here

TITLES = {
    "about": gettext_lazy("About the study"),
    "recruitment": gettext_lazy("Recruitment"),
    DESIGN: gettext_lazy("Design"),
    "conditions": gettext_lazy("Conditions"),
    "courses": gettext_lazy("Courses"),
    "steps": gettext_lazy("Steps"),
    "analyses": gettext_lazy("Analyses"),
    PLAN: gettext_lazy("Plan"),
    "rules": gettext_lazy("Rules"),
    "wizard": gettext_lazy("Hidden operator"),
    "coding": gettext_lazy("Coding of replays"),
}
WALK_THROUGH = "walk_through"  # beside the sections: experiments/study_admin/walk_through.py
MOST_SHOWN = 40  # problems above a form
TEMPLATES = {"courses": "course", DESIGN: "design"}  # of forms; "part" of all others


@dataclass(frozen=True)
class LinkedProblem:
    text: str
    url: str = ""


def whole_of(row: Row) -> Document:
    document: Document = msgspec.to_builtins(row.as_definition())
    return {**{name: [] for name in LISTS}, **document}


def address(row: Row, place: BuilderPlace) -> str:
    """Return the address of a page of the builder; all factors are on that of the design."""
    if place.index is None or place.section == "factors":
        page = {**INNER_LISTS, "factors": DESIGN}.get(place.section, place.section)
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
            "label": str(title),
            "url": address(row, BuilderPlace(name)),
            "count": len(row.definition.get(name, ())) if name in LISTS else None,
        }
        for name, title in TITLES.items()
    ]
    last = {"key": WALK_THROUGH, "label": _("Walk through"), "url": walk, "count": None}
    return [*found, last]


def told(row: Row) -> list[LinkedProblem]:
    """Return everything that is wrong with a study, or stands in its way here."""
    return linked(row, publishing.problems_of(row))


def doubted(row: Row) -> list[LinkedProblem]:
    """Return what must be confirmed before the study is published."""
    return linked(row, list(doubts(row.as_definition())))


def linked(row: Row, problems: list[Problem]) -> list[LinkedProblem]:
    """Return problems in the language of the page, each with the page on which it is mended."""
    whole = whole_of(row)
    found = by_place(problems, lambda one: one.sentence(_), lambda one: _text_name(one, whole))
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


class BuilderPages(StudyPages):
    def builder_urls(self) -> list[URLPattern]:
        start = "build/<slug:section>/"
        return [
            self.study_path(start, self.section_view, "section"),
            self.study_path(f"{start}<int:index>/", self.part_view, "part"),
            self.study_path(f"{start}<int:index>/check/", self.check_view, "check"),
        ]

    def section_view(self, request: HttpRequest, pk: Any, section: str) -> HttpResponse:
        """Show a page of the study's own fields, or a list of its parts; a POST changes them."""
        row = study_for(request, pk, "viewer")
        if section in {*PAGES, PLAN, DESIGN}:
            return self._form(request, row, BuilderPlace(section))
        if section not in {*LISTS, *INNER_LISTS} - {"factors"}:
            raise Http404
        if request.method == "POST":
            return self._change_list(request, _to_change(request, row), section)
        if section in INNER_LISTS:
            return HttpResponseRedirect(address(row, BuilderPlace(section)))
        return self._render(request, row, "list", section, _list_of(row, section))

    def part_view(self, request: HttpRequest, pk: Any, section: str, index: int) -> HttpResponse:
        return self._form(request, study_for(request, pk, "viewer"), BuilderPlace(section, index))

    def check_view(self, request: HttpRequest, pk: Any, section: str, index: int) -> JsonResponse:
        """Tell what stands in the way of a course as it is on the page, saved or not."""
        row, place = study_for(request, pk, "viewer"), BuilderPlace(section, index)
        whole = whole_of(row)
        part = place.part(whole)
        if request.method != "POST" or section != "courses" or part is None:
            raise Http404
        draft = _read(request, row, place, whole)
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
        if part is None or place.section == "factors":
            raise Http404
        if request.method != "POST":
            return self._show(request, row, place, SubmittedPart(part))
        _to_change(request, row)
        draft = _read(request, row, place, whole)
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
        whole = whole_of(row)
        former = place.part(whole) or draft.part
        form = _shown_form(row, place, draft, whole, former)
        if "questionnaire" in former:
            leads_here(request, row.shown_title, address(row, place))
        advised = advice(row.as_definition(), place, get_language() or "")
        context: Document = {
            "advice": [LinkedProblem(text, address(row, other)) for text, other in advised],
            "form": form,
            "place": place,
            "above": draft.above,
            "has_errors": bool(draft.errors),
            "part_title": title_of(former, whole) if place.index is not None else "",
        }
        if place.section == "steps":
            page = page_type(former["kind"])
            context |= {"kind": page.label, "told": page.told, "walked": former["key"]}
        elif place.section == "courses":
            args = [row.pk, "courses", place.index]
            check = reverse("admin:experiments_study_check", args=args)
            context |= {"course": drawn_course(draft.part), "check": check}
        elif place.section == DESIGN:
            context |= {
                "table": design_table(row.as_definition()),
                "shared": form.offered["shared"],
            }
        inner = next((one for one, page in INNER_LISTS.items() if page == place.section), None)
        if inner is not None and whole.get(place.section) is not None:
            listed = reverse("admin:experiments_study_section", args=[row.pk, inner])
            context |= {"list_title": GUIDE.label(inner), "list_address": listed}
            context |= _list_of(row, inner)
        template = TEMPLATES.get(place.section, "part")
        return self._render(
            request, row, template, place.section, context, place=place, status=status
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
        found, tab = told(row), INNER_LISTS.get(section, section)
        mine = [one for one in found if place is None or one.url == address(row, place)]
        context = {
            "section": tab,
            "sections": sections(row),
            "problems": mine[:MOST_SHOWN],
            "doubts": doubted(row),
            "elsewhere": len(found) - len(mine),
            "may_change": _may_change(request, row),
            "pilots": row.participants.count(),
        }
        return self.study_page(
            request,
            row,
            f"builder_{page}",
            TITLES[tab],
            context | more,
            tab="builder",
            status=status,
        )

    # --- lists ------------------------------------------------------------------------------------

    def _change_list(self, request: HttpRequest, row: Row, section: str) -> HttpResponse:
        verb, what = pressed(request.POST, 2)
        whole = whole_of(row)
        parts, place = parts_in(whole, section), BuilderPlace(section)
        n = number(what)
        if verb == "add":
            new = _new(section, what, whole)
            n = len(parts) if section != "steps" else landing(whole, new)
            if n is None:
                raise Http404
            changed, place = [*parts[:n], new, *parts[n:]], BuilderPlace(section, n)
        else:
            changed = change(parts, verb, n)
            if verb == "copy" and len(changed) > len(parts):
                changed[n + 1] = copied(section, parts[n], whole)
                place = BuilderPlace(section, n + 1)
        is_same = request.POST.get("sha256") == row.sha256
        saved = _keep(row, with_parts(whole, section, changed)) if is_same else str(MEANWHILE)
        if isinstance(saved, str):
            messages.error(request, saved)
            place = BuilderPlace(section)
        return HttpResponseRedirect(address(row, place))


def _may_change(request: HttpRequest, row: Row) -> bool:
    return row.status == Row.Status.DRAFT and may(request.user, row.slug, "owner")


def _to_change(request: HttpRequest, row: Row) -> Row:
    """Return the row when it may be changed; for whoever may not, a page that changes it is not
    there.
    """
    if not _may_change(request, row):
        raise Http404
    return row


def _shown_form(
    row: Row, place: BuilderPlace, draft: SubmittedPart, whole: Document, former: Document
) -> StudyPartForm:
    form = StudyPartForm(
        place.cls(former),
        draft.part,
        languages=whole["languages"],
        offered=offered(row, whole, draft.part, place.section),
        only=place.only,
        is_sent=bool(draft.errors),
        decided=("Allocation.design",) if whole["factors"] else (),
    )
    for name in draft.errors.keys() & form.fields.keys() - form.errors.keys():
        form.add_error(name, draft.errors[name])
    if place.section == "conditions":
        for name, title in set_by_levels(row.as_definition(), former["key"]).items():
            form.fix(name, _("Set by the level “%(title)s” of the design.") % {"title": title})
    return form


def _read(request: HttpRequest, row: Row, place: BuilderPlace, whole: Document) -> SubmittedPart:
    """Return what a form says after its button: `save`, `add:<list>`, or
    `remove|up|down:<list>:<n>`.
    """
    former, study = place.part(whole) or {}, row.as_definition()
    cls = place.cls(former)
    part = StudyPartForm.read(cls, request.POST, only=place.only)
    refused = _store_media(request, row, part)
    anchor = _press(part, request.POST, whole["languages"])
    match place.section:
        case "courses":
            part = renumber(part)
        case "conditions":
            restore(part, former, set_by_levels(study, former["key"]))
        case "design":
            complete(part, whole, whole["languages"])
        case "analyses":
            write_contrasts(study, part)
        case "plan":
            write_claims(study, part)
    listed: Document = {"shared": request.POST.getlist("shared_fields")}
    told = StudyPartForm(cls, part, offered=listed, only=place.only, is_sent=True).refusals
    if place.section == "conditions" and not told:
        told = speeds_refused(part)
    return SubmittedPart(part, told | refused, anchor=anchor)


def _store_media(request: HttpRequest, row: Row, part: Document) -> dict[str, str]:
    """Store the files that were sent with pages of instructions; return why some were not, by the
    field of the picture.
    """
    refused = {}
    for n, page in enumerate(part.get("leaves", ())):
        name = f"leaves.{n}.picture"
        if file := request.FILES.get(f"{name}.file"):
            try:
                page["picture"] = instruction_media.store(row.slug, file, timezone.now())
            except instruction_media.RefusedMediaError as error:
                refused[name] = str(error)
    return refused


def _press(part: Document, sent: Any, languages: Collection[str]) -> str:
    """Do what the button of a form says to one of the lists in it, and return where the page
    continues.
    """
    verb, name, what = pressed(sent)
    values = list_in(part, name) if verb in {"add", "remove", "up", "down"} else None
    if values is None:
        return ""
    if verb != "add":
        values[:] = change(values, verb, number(what))
        return name
    if name == "steps":
        new = new_script_step(part, what, places(publishing.sites().values()))
    else:
        middle = middle_of(publishing.sites().get(part.get("site", "")))
        at = clicked_point(sent.get("at", ""), middle)
        new = new_part(name, values, what, languages, at)
    values += [new] if new else []
    return "course" if sent.get("at") else f"{name}.{len(values) - 1}"


def _save(request: HttpRequest, row: Row, place: BuilderPlace, draft: SubmittedPart) -> Row | None:
    """Store what a form says; None with the reason in the draft when that cannot be."""
    if request.POST.get("sha256") != row.sha256:
        draft.above.append(str(MEANWHILE))
        return None
    whole, part = whole_of(row), draft.part
    names = Renamed()
    if place.section == DESIGN:
        names = renaming(part)
    elif place.index is not None and place.section in {"conditions", "analyses"}:
        old = parts_in(whole, place.section)[place.index]["key"]
        names = Renamed(**{place.section: {old: part["key"]}})
    kept = _keep(row, place.put(renamed(whole, names), part), draws=place.section == DESIGN)
    if isinstance(kept, str):
        draft.above.append(kept)
        return None
    return kept


def _keep(row: Row, whole: Document, *, draws: bool = False) -> Row | str:
    """Store a study with what follows from its design; `draws` adds the courses that it lacks."""
    try:
        study, here = msgspec.convert(whole, StudyDefinition), at_hand()
        blank = msgspec.convert(new_condition(whole, here), Condition)
        study = arranged(study, row.as_definition(), blank)
        if draws:
            study = msgspec.convert(with_courses(msgspec.to_builtins(study), here), StudyDefinition)
        return publishing.save_draft(row, study)
    except msgspec.ValidationError as error:
        return f"{error}."
    except ChangedMeanwhileError:
        return _("Not saved: someone changed or published this study at the same time. Try again.")


# --- what is shown --------------------------------------------------------------------------------


def _list_of(row: Row, section: str) -> Document:
    """Return the parts of a list, the kinds that can be added, and whether the list follows from
    the design.
    """
    whole = whole_of(row)
    is_derived = section == "conditions" and bool(whole["factors"])
    offered_kinds = [
        (kind, words)
        for kind, words in ([] if is_derived else kinds(section))
        if section != "steps" or landing(whole, _new(section, kind, whole)) is not None
    ]
    parts = list(_listed(row, section, whole))
    return {"parts": parts, "kinds": offered_kinds, "is_derived": is_derived}


def _listed(row: Row, section: str, whole: Document) -> Iterator[dict[str, Any]]:
    titles = questionnaire_titles() if section == "steps" else {}
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
    blank = {"analyses": new_analysis, "stages": new_stage, "codes": new_code}
    if section in blank:
        return blank[section](whole)
    here = at_hand()
    return new_condition(whole, here) if section == "conditions" else new_course(whole, here)
