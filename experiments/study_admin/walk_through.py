"""Walking through a study as its participants see it: every step in order, in any of its languages
and conditions, at a chosen width. Mixed into the studies' administration.

The participant is in no database. Each page is drawn by the step's own code
(experiments.participation.step_page.StepPage.preview), in a frame within the administration; all
that a page sends only leads to the next one. Robots are driven by pilots instead.
"""

from typing import Any

from csp.constants import SELF
from csp.decorators import csp_replace
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase, HttpResponseRedirect
from django.urls import reverse
from django.utils import timezone, translation
from django.utils.translation import gettext as _, gettext_lazy
from django.views.decorators.clickjacking import xframe_options_sameorigin

from accounts.models import User
from experiments.builder.study_page import StudyPages, View, study_view
from experiments.builder.views import WALK_THROUGH, sections
from experiments.definition.schema import StudyDefinition
from experiments.models import Participant, ParticipantKind, Study
from experiments.participation import journey
from experiments.participation.assignment import Access
from experiments.participation.steps import page_of
from surveys.document_forms.fields import language_name
from surveys.documents import spoken

# by width: what it is called, and the frame's size in pixels
WIDTHS = {
    "phone": (gettext_lazy("Phone"), (390, 760)),
    "tablet": (gettext_lazy("Tablet"), (820, 760)),
    "computer": (gettext_lazy("Computer"), (1280, 760)),
}
STEP = "walk-through/<slug:language>/<int:number>"


def _in_frame(view: View) -> View:
    return xframe_options_sameorigin(csp_replace({"frame-ancestors": [SELF]})(view))


class WalkThroughPages(StudyPages):
    @study_view("walk-through/", "walk_through")
    def walk_through_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        """Show the steps, one in a frame: `?language=es&width=phone&condition=a&step=task`."""
        definition = row.as_definition()
        language = _one_of(definition.languages, request.GET.get("language", ""))
        width = _one_of(tuple(WIDTHS), request.GET.get("width", ""))
        condition = request.GET.get("condition", "")
        condition = condition if definition.condition(condition) is not None else ""
        route = _route(definition, condition)
        keys = [place.step for place in route]
        titles = [spoken(journey.step_at(definition, one).title, language) for one in route]
        steps = [
            (_address(row, language, number, condition), title or key)
            for number, (title, key) in enumerate(zip(titles, keys, strict=True), start=1)
        ]
        conditions = {one.key: spoken(one.title, language) for one in definition.conditions}
        asked = request.GET.get("step", "")
        first = keys.index(asked) if asked in keys else 0
        context: dict[str, Any] = {
            "sections": sections(row),
            "section": WALK_THROUGH,
            "steps": steps,
            "shown": steps[first][0] if steps else "",
            "languages": [(code, language_name(code)) for code in definition.languages],
            "conditions": [(key, text or key) for key, text in conditions.items()],
            "widths": [(key, name) for key, (name, _size) in WIDTHS.items()],
            "size": WIDTHS[width][1],
        }
        context |= {"step": asked, "language": language, "condition": condition, "width": width}
        title = _("Walk through as a participant")
        return self.study_page(request, row, "walk_through", title, context, tab="builder")

    @study_view(f"{STEP}/", "walked_step", guard=_in_frame)
    @study_view(f"{STEP}/<slug:condition>/", "walked_step", guard=_in_frame)
    def walked_step_view(
        self, request: HttpRequest, row: Study, language: str, number: int, condition: str = ""
    ) -> HttpResponseBase:
        """Show a step, from 1. A POST is not read, and leads to the next step."""
        definition = row.as_definition()
        if condition and definition.condition(condition) is None:
            raise Http404
        route = _route(definition, condition)
        if language not in definition.languages or not 1 <= number <= len(route):
            raise Http404
        if request.method == "POST":
            following = min(number + 1, len(route))
            return HttpResponseRedirect(_address(row, language, following, condition))
        with translation.override(language):
            request.LANGUAGE_CODE = language
            participant = _participant(row, route, number, language, condition)
            step = journey.step_at(definition, route[number - 1])
            return page_of(participant, step).preview(request, timezone.now())


def _address(row: Study, language: str, number: int, condition: str) -> str:
    args = [row.pk, language, number, *([condition] if condition else [])]
    return reverse("admin:experiments_study_walked_step", args=args)


def _access(definition: StudyDefinition, condition: str) -> Access:
    """Return how those join who see a condition, or any condition of the study."""
    chosen = definition.condition(condition)
    shown = [chosen] if chosen is not None else definition.conditions
    return "open" if not shown or any(one.access == "open" for one in shown) else "invitation"


def _route(definition: StudyDefinition, condition: str) -> tuple[journey.JourneyPlace, ...]:
    often = journey.rounds(definition, _access(definition, condition))
    return journey.route(definition, often, 1)


def _participant(
    row: Study, route: tuple[journey.JourneyPlace, ...], number: int, language: str, condition: str
) -> Participant:
    """Return an unsaved participant at a place of a route, with a condition for every round."""
    place = route[number - 1]
    user, kind = User(kind=User.Kind.PARTICIPANT), ParticipantKind.PILOT
    where = {"visit": place.visit, "round": place.round, "step": place.step, "language": language}
    access = _access(row.as_definition(), condition)
    participant = Participant(study=row, user=user, kind=kind, access=access, **where)
    if condition:
        participant.conditions = [condition] * (1 + route[-1].round)
        participant.stage = Participant.Stage.UNDER_WAY
    return participant


def _one_of(known: tuple[str, ...], asked: str) -> str:
    return asked if asked in known else next(iter(known), "en")
