"""The study builder: pages that edit a definition without JSON and JavaScript.

A page is a form over one place of the definition (experiments/builder/pages.py). Every button sends
the whole form, so that adding, removing or moving a part loses no input. Drafts may be incomplete;
their problems are listed above the form.
"""

from collections.abc import Collection, Iterable
from dataclasses import astuple, dataclass, replace
from typing import Any

import msgspec
from django.contrib import messages
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect, JsonResponse
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import get_language, gettext as _, gettext_lazy

from experiments import instruction_media, publishing, resources
from experiments.access import may
from experiments.builder import choices, pages
from experiments.builder.advice import advice
from experiments.builder.arrangement import Renamed, arranged, renamed
from experiments.builder.design import complete, design_table, renaming, restore, set_by_levels
from experiments.builder.labels import GUIDE
from experiments.builder.pages import DESIGN, INNER_LISTS, LISTS, PLAN, BuilderPlace, parts_in
from experiments.builder.study_form import StudyPartForm
from experiments.builder.study_page import StudyPages, study_view
from experiments.builder.summaries import about, kinds, title_of
from experiments.definition.problems import doubts, problems
from experiments.definition.schema import Condition, StudyDefinition
from experiments.definition.steps import KINDS
from experiments.models import Study as Row
from experiments.participation.steps import page_type
from robots.models import FloorPlan
from robots.plans.floorplans import plan_content
from surveys.document_forms.part_form import MEANWHILE, SubmittedPart, number, pressed
from surveys.document_forms.parts import Document, change
from surveys.document_forms.problem_text import by_place, sentences, text_name
from surveys.documents import ChangedMeanwhileError, Problem, ProblemPlace
from surveys.editor.views import leads_here

TITLES = {
    "about": gettext_lazy("About the study"),
    "recruitment": gettext_lazy("Site, screening and appointments"),
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
WALK_THROUGH = "walk_through"  # the tab of experiments/study_admin/walk_through.py
BUILD = "build/<slug:section>"  # the addresses of the builder, below that of a study
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
    """Return the address of a page of the builder; that of the design has all factors."""
    if place.index is None or place.section == "factors":
        page = {**INNER_LISTS, "factors": DESIGN}.get(place.section, place.section)
        return reverse("admin:experiments_study_section", args=[row.pk, page])
    return reverse("admin:experiments_study_part", args=[row.pk, place.section, place.index])


def sections(row: Row) -> list[dict[str, Any]]:
    """Return the tabs of the builder, lists with their lengths; the last is the walk through."""
    found: list[dict[str, Any]] = []
    for name, title in TITLES.items():
        url, is_list = address(row, BuilderPlace(name)), name in LISTS
        count = len(row.definition.get(name, ())) if is_list else None
        found.append({"key": name, "label": str(title), "url": url, "count": count})
    walk = reverse("admin:experiments_study_walk_through", args=[row.pk])
    last = {"key": WALK_THROUGH, "label": _("Walk through"), "url": walk, "count": None}
    return [*found, last]


def linked_problems(row: Row) -> list[LinkedProblem]:
    return linked(row, publishing.problems_of(row))


def linked_doubts(row: Row) -> list[LinkedProblem]:
    return linked(row, doubts(row.as_definition()))


def linked(row: Row, found: Iterable[Problem]) -> list[LinkedProblem]:
    whole = whole_of(row)

    def title(part: Document) -> str:
        return title_of(part, whole) if "key" in part else ""

    def name(one: Problem) -> str:
        part = BuilderPlace(one.place.section, one.place.part).part(whole)
        around = [title_of(part, whole)] if part is not None and part is not whole else []
        return " · ".join([*around, text_name(GUIDE, part, one.path, title)])

    return [
        LinkedProblem(text, address(row, BuilderPlace(*astuple(place))) if place.section else "")
        for place, texts in by_place(found, lambda one: one.sentence(_), name).items()
        for text in texts
    ]


class BuilderPages(StudyPages):
    @study_view(f"{BUILD}/", "section")
    def section_view(self, request: HttpRequest, row: Row, section: str) -> HttpResponse:
        if section in {*pages.PAGES, PLAN, DESIGN}:
            return self._form(request, row, BuilderPlace(section))
        if section not in {*LISTS, *INNER_LISTS} - {"factors"}:
            raise Http404
        if request.method == "POST":
            return self._change_list(request, row, section)
        if section in INNER_LISTS:
            return HttpResponseRedirect(address(row, BuilderPlace(section)))
        return self._render(request, row, BuilderPlace(section), _list_of(row, section))

    @study_view(f"{BUILD}/<int:index>/", "part")
    def part_view(self, request: HttpRequest, row: Row, section: str, index: int) -> HttpResponse:
        return self._form(request, row, BuilderPlace(section, index))

    @study_view(f"{BUILD}/<int:index>/check/", "check")
    def check_view(self, request: HttpRequest, row: Row, section: str, index: int) -> JsonResponse:
        """Return the problems of a course as it is on the page, saved or not."""
        place = BuilderPlace(section, index)
        whole = whole_of(row)
        part = place.part(whole)
        if request.method != "POST" or section != "courses" or part is None:
            raise Http404
        draft = _read(request, row, place, whole)
        if draft.errors:
            found = list(dict.fromkeys(draft.errors.values()))
            return JsonResponse({"problems": found, "checkpoints": []})
        study = msgspec.convert(place.put(whole, draft.part), StudyDefinition)
        return JsonResponse(course_check(study, index))

    def _form(self, request: HttpRequest, row: Row, place: BuilderPlace) -> HttpResponse:
        whole = whole_of(row)
        part = place.part(whole)
        if part is None or place.section == "factors":
            raise Http404
        if request.method != "POST":
            return self._show(request, row, place, SubmittedPart(part))
        _require_change(request, row)
        draft = _read(request, row, place, whole)
        draft.above += [] if draft.errors else _save(request, row, place, draft)
        row.refresh_from_db()
        if draft.is_refused:
            return self._show(request, row, place, draft)
        n = "" if place.index is None else f" {place.index + 1}"
        publishing.log(row, request.user, f"Changed: {place.section}{n}.")
        messages.success(request, _("Saved."))
        anchor = f"#{draft.anchor}" if draft.anchor else ""
        return HttpResponseRedirect(address(row, place) + anchor)

    def _show(
        self, request: HttpRequest, row: Row, place: BuilderPlace, draft: SubmittedPart
    ) -> HttpResponse:
        whole = whole_of(row)
        former = place.part(whole) or draft.part
        form = _shown_form(row, place, draft, whole, former)
        if "questionnaire" in former:
            leads_here(request, row.shown_title, address(row, place))
        advised = advice(row.as_definition(), place, get_language() or "")
        links = [LinkedProblem(text, address(row, other)) for text, other in advised]
        title = title_of(former, whole) if place.index is not None else ""
        context: Document = {"form": form, "place": place, "advice": links, "part_title": title}
        context |= {"above": draft.above, "has_errors": bool(draft.errors)}
        if place.section == "steps":
            page = page_type(former["kind"])
            context |= {"kind": page.label, "told": page.note, "walked": former["key"]}
        elif place.section == "courses":
            args = [row.pk, "courses", place.index]
            check = reverse("admin:experiments_study_check", args=args)
            context |= {"course": drawn_course(draft.part), "check": check}
        elif place.section == DESIGN:
            table = design_table(row.as_definition())
            context |= {"table": table, "shared": form.offered["shared"]}
        inner = next((one for one, page in INNER_LISTS.items() if page == place.section), None)
        if inner is not None and whole.get(place.section) is not None:
            listed = reverse("admin:experiments_study_section", args=[row.pk, inner])
            context |= {"list_title": GUIDE.label(inner), "list_address": listed}
            context |= _list_of(row, inner)
        return self._render(request, row, place, context, 422 if draft.is_refused else 200)

    def _render(
        self, request: HttpRequest, row: Row, place: BuilderPlace, more: Document, status: int = 200
    ) -> HttpResponse:
        """Show a list, or the form of a `place` with its own problems; `more` is its context."""
        is_draft = row.status == Row.Status.DRAFT
        found = linked_problems(row) if is_draft else []
        tab = INNER_LISTS.get(place.section, place.section)
        is_form = "form" in more
        mine = [one for one in found if not is_form or one.url == address(row, place)]
        context = {
            "section": tab,
            "sections": sections(row),
            "problems": mine[:MOST_SHOWN],
            "doubts": linked_doubts(row) if is_draft else [],
            "elsewhere": len(found) - len(mine),
            "may_change": _may_change(request, row),
            "pilots": row.participants.count(),
        } | more
        page = TEMPLATES.get(place.section, "part") if is_form else "list"
        name, title = f"builder_{page}", TITLES[tab]
        return self.study_page(request, row, name, title, context, tab="builder", status=status)

    def _change_list(self, request: HttpRequest, row: Row, section: str) -> HttpResponse:
        _require_change(request, row)
        verb, what = pressed(request.POST, 2)
        whole = whole_of(row)
        parts, place = parts_in(whole, section), BuilderPlace(section)
        n = number(what)
        if verb == "add":
            new = _new(section, what, whole)
            n = len(parts) if section != "steps" else pages.landing(whole, new)
            if n is None:
                raise Http404
            changed, place = [*parts[:n], new, *parts[n:]], BuilderPlace(section, n)
        else:
            changed = change(parts, verb, n)
            if verb == "copy" and len(changed) > len(parts):
                changed[n + 1] = pages.copied(section, parts[n], whole)
                place = BuilderPlace(section, n + 1)
        is_same = request.POST.get("sha256") == row.sha256
        new_whole = pages.with_parts(whole, section, changed)
        reasons = _store(row, new_whole) if is_same else [str(MEANWHILE)]
        for reason in reasons:
            messages.error(request, reason)
            place = BuilderPlace(section)
        return HttpResponseRedirect(address(row, place))


def _may_change(request: HttpRequest, row: Row) -> bool:
    return row.status == Row.Status.DRAFT and may(request.user, row.slug, "owner")


def _require_change(request: HttpRequest, row: Row) -> None:
    if not _may_change(request, row):
        raise Http404


def _shown_form(
    row: Row, place: BuilderPlace, draft: SubmittedPart, whole: Document, former: Document
) -> StudyPartForm:
    given: Document = {"languages": whole["languages"], "only": place.only}
    given |= {"offered": choices.offered(row, whole, draft.part, place.section)}
    given["is_sent"] = bool(draft.errors)
    given["decided"] = ("Allocation.design",) if whole["factors"] else ()
    form = StudyPartForm(place.cls(former), draft.part, **given)
    for name in draft.errors.keys() & form.fields.keys() - form.errors.keys():
        form.add_error(name, draft.errors[name])
    if place.section == "conditions":
        for name, title in set_by_levels(row.as_definition(), former["key"]).items():
            form.fix(name, _("Set by the level “%(title)s” of the design.") % {"title": title})
    return form


def _read(request: HttpRequest, row: Row, place: BuilderPlace, whole: Document) -> SubmittedPart:
    """Return a form after its button: `save`, `add:<list>`, or `remove|up|down:<list>:<n>`."""
    former, study = place.part(whole) or {}, row.as_definition()
    cls = place.cls(former)
    part = StudyPartForm.read(cls, request.POST, only=place.only)
    refused = _store_media(request, row, part)
    anchor = _press(part, request.POST, place, cls, whole["languages"])
    match place.section:
        case "courses":
            part = pages.renumber(part)
        case "conditions":
            restore(part, former, set_by_levels(study, former["key"]))
        case "design":
            complete(part, whole, whole["languages"])
        case "analyses":
            choices.write_contrasts(study, part)
        case "plan":
            choices.write_claims(study, part)
    listed: Document = {"shared": request.POST.getlist("shared_fields")}
    errors = StudyPartForm(cls, part, offered=listed, only=place.only, is_sent=True).refusals
    if place.section == "conditions" and not errors:
        errors = choices.speeds_refused(part)
    return SubmittedPart(part, errors | refused, anchor=anchor)


def _store_media(request: HttpRequest, row: Row, part: Document) -> dict[str, str]:
    """Store uploads for pages of instructions; return the errors by field of the picture."""
    refused = {}
    for n, page in enumerate(part.get("leaves", ())):
        name = f"leaves.{n}.picture"
        if file := request.FILES.get(f"{name}.file"):
            try:
                page["picture"] = instruction_media.store(row.slug, file, timezone.now())
            except instruction_media.RefusedMediaError as error:
                refused[name] = str(error)
    return refused


def _press(
    part: Document, sent: Any, place: BuilderPlace, cls: type[Any], languages: Collection[str]
) -> str:
    """Apply a button of a form to one of the lists in it; return the anchor to continue at."""
    verb, name, what = pressed(sent)
    values = StudyPartForm.list_in(part, name, cls, place.only)
    if values is None or verb not in {"add", "remove", "up", "down"}:
        return ""
    if verb != "add":
        values[:] = change(values, verb, number(what))
        return name
    if name == "steps":
        new = pages.new_script_step(part, what, choices.places(resources.sites().values()))
    else:
        middle = pages.middle_of(resources.sites().get(part.get("site", "")))
        at = pages.clicked_point(sent.get("at", ""), middle)
        new = pages.new_part(name, values, what, languages, at)
    values += [new] if new else []
    return "course" if sent.get("at") else f"{name}.{len(values) - 1}"


def _save(request: HttpRequest, row: Row, place: BuilderPlace, draft: SubmittedPart) -> list[str]:
    if request.POST.get("sha256") != row.sha256:
        return [str(MEANWHILE)]
    whole, part = whole_of(row), draft.part
    names = Renamed()
    if place.section == DESIGN:
        names = renaming(part)
    elif place.index is not None and place.section in {"conditions", "analyses"}:
        old = parts_in(whole, place.section)[place.index]["key"]
        names = Renamed(**{place.section: {old: part["key"]}})
    return _store(row, place.put(renamed(whole, names), part), draws=place.section == DESIGN)


def _store(row: Row, whole: Document, *, draws: bool = False) -> list[str]:
    """Store a study with what its design implies, or return why not; `draws` adds courses."""
    try:
        study, here = msgspec.convert(whole, StudyDefinition), choices.at_hand()
        blank = msgspec.convert(pages.new_condition(whole, here), Condition)
        study = arranged(study, row.as_definition(), blank)
        if draws:
            document = pages.with_courses(msgspec.to_builtins(study), here)
            study = msgspec.convert(document, StudyDefinition)
        publishing.save_draft(row, study)
    except msgspec.ValidationError as error:
        return [f"{error}."]
    except ChangedMeanwhileError:
        words = _("Not saved: someone changed or published this study at the same time. Try again.")
        return [words]
    return []


def _list_of(row: Row, section: str) -> Document:
    """Return the parts of a list, the kinds to add, and whether they follow from the design."""
    whole = whole_of(row)
    is_derived = section == "conditions" and bool(whole["factors"])
    titles = choices.questionnaire_titles() if section == "steps" else {}
    parts: list[Document] = []
    for n, part in enumerate(parts_in(whole, section)):
        listed = {"url": address(row, BuilderPlace(section, n)), "n": n}
        words = {"title": title_of(part, whole), "about": [*about(section, part, whole, titles)]}
        parts.append({**listed, **words})

    def fits(kind: str) -> bool:
        return section != "steps" or pages.landing(whole, _new(section, kind, whole)) is not None

    offered = [] if is_derived else [one for one in kinds(section) if fits(one[0])]
    return {"parts": parts, "kinds": offered, "is_derived": is_derived}


def drawn_course(course: Document) -> Document:
    """Return what draws the ground of a course; the plan of an unknown site is None."""
    plan = FloorPlan.objects.filter(name=course.get("site", "")).first()
    content = plan_content(plan) if plan is not None else None
    return {"plan": content, "robot": course.get("robot", "")}


def course_check(study: StudyDefinition, n: int) -> Document:
    """Return the problems of a course, and of its conditions because of it, with checkpoints."""
    course = study.courses[n]
    mine = (one for one in problems(study) if one.place == ProblemPlace("courses", n))
    place = (course.robot, course.site)
    conditions = tuple(one for one in study.conditions if (one.robot, one.site) == place)
    task = tuple(step for step in study.steps if step is study.task)
    alone = msgspec.structs.replace(study, courses=(course,), conditions=conditions, steps=task)
    # Missing texts are listed above the form; on its page the course needs no name.
    found = [
        replace(one, names=one.names[1:]) if one.place.section == "courses" else one
        for one in (*mine, *resources.obstacles_here(alone))
        if not one.language
    ]
    numbers = {one.path[1] for one in found if one.path[:1] == ("checkpoints",)}
    return {"problems": sentences(found), "checkpoints": sorted(numbers)}


def _new(section: str, kind: str, whole: Document) -> Document:
    if section == "steps":
        if kind not in KINDS:
            raise Http404
        return pages.new_step(kind, page_type(kind).blank, whole)
    make = {"conditions": pages.new_condition, "courses": pages.new_course}.get(section)
    return make(whole, choices.at_hand()) if make else pages.new_in(section, whole)
