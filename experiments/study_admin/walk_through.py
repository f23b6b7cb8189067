"""Walking through a study as its participants see it: every step in order, in any of its languages,
at the width of a phone or of a computer. Mixed into the studies' administration.

The participant is in no database. Each page is drawn by the step's own code
(experiments.participation.step_page.StepPage.preview), in a frame within the administration;
whatever a page sends only leads to the next one. Robots are driven by pilots instead.
"""

from typing import Any

from csp.constants import SELF
from csp.decorators import csp_replace
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase, HttpResponseRedirect
from django.urls import URLPattern, path, reverse
from django.utils import timezone, translation
from django.utils.translation import gettext as _
from django.views.decorators.cache import never_cache
from django.views.decorators.clickjacking import xframe_options_sameorigin

from accounts.models import User
from experiments.definition.schema import StudyDefinition
from experiments.models import Participant, ParticipantKind, Study
from experiments.participation import journey
from experiments.participation.assignment import Access
from experiments.participation.steps import page_of
from experiments.research.study_access import study_for
from surveys.documents import spoken

WIDTHS = {"phone": (390, 760), "tablet": (820, 760), "computer": (1280, 760)}  # pixels


class WalkThroughPages:
    """The frame, and the pages in it."""

    def walk_through_urls(self) -> list[URLPattern]:
        """Return their addresses."""
        guard = self.admin_site.admin_view  # type: ignore[attr-defined]
        step = xframe_options_sameorigin(
            csp_replace({"frame-ancestors": [SELF]})(never_cache(self.walked_step_view))
        )
        return [
            path(
                "<uuid:pk>/walk-through/",
                guard(never_cache(self.walk_through_view)),
                name="experiments_study_walk_through",
            ),
            path(
                "<uuid:pk>/walk-through/<slug:language>/<int:number>/",
                guard(step),
                name="experiments_study_walked_step",
            ),
        ]

    def walk_through_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Show the steps, and the one that is chosen in a frame of the chosen width:
        `?language=es&width=phone`.
        """
        row = study_for(request, pk, "viewer")
        definition = row.as_definition()
        language = _one_of(definition.languages, request.GET.get("language", ""))
        width = _one_of(tuple(WIDTHS), request.GET.get("width", ""))
        steps = [
            (
                reverse("admin:experiments_study_walked_step", args=[row.pk, language, number]),
                spoken(journey.step_at(definition, place).title, language) or place.step,
            )
            for number, place in enumerate(_route(definition), start=1)
        ]
        return self._page(  # type: ignore[attr-defined, no-any-return]
            request,
            row,
            "walk_through",
            _("Walk through as a participant"),
            steps=steps,
            language=language,
            languages=definition.languages,
            width=width,
            widths=[
                ("phone", _("Phone")),
                ("tablet", _("Tablet")),
                ("computer", _("Computer")),
            ],
            size=WIDTHS[width],
        )

    def walked_step_view(
        self, request: HttpRequest, pk: Any, language: str, number: int
    ) -> HttpResponseBase:
        """Show a step, from 1; whatever is sent leads to the next one, and is not read."""
        row = study_for(request, pk, "viewer")
        definition = row.as_definition()
        way = _route(definition)
        if language not in definition.languages or not 1 <= number <= len(way):
            raise Http404
        if request.method == "POST":
            following = min(number + 1, len(way))
            return HttpResponseRedirect(
                reverse("admin:experiments_study_walked_step", args=[pk, language, following])
            )
        with translation.override(language):
            request.LANGUAGE_CODE = language
            participant = _nobody(row, definition, way[number - 1], language)
            step = journey.step_at(definition, way[number - 1])
            return page_of(participant, step).preview(request, timezone.now())


def _access(definition: StudyDefinition) -> Access:
    """Return how people come in who see the most of the study."""
    is_open = any(condition.access == "open" for condition in definition.conditions)
    return "open" if is_open or not definition.conditions else "invitation"


def _route(definition: StudyDefinition) -> tuple[journey.JourneyPlace, ...]:
    often = journey.rounds(definition, _access(definition))
    return journey.route(definition, often, 1)


def _nobody(
    row: Study, definition: StudyDefinition, place: journey.JourneyPlace, language: str
) -> Participant:
    """Return a participant at a place who is never saved."""
    return Participant(
        study=row,
        user=User(kind=User.Kind.PARTICIPANT, display_name=_("Participant")),
        kind=ParticipantKind.PILOT,
        access=_access(definition),
        visit=place.visit,
        round=place.round,
        step=place.step,
        language=language,
    )


def _one_of(known: tuple[str, ...], asked: str) -> str:
    return asked if asked in known else next(iter(known), "en")
