"""The pages of the instructions, one at a time."""

import datetime

from django.conf import settings
from django.http import HttpRequest, HttpResponseBase
from django.utils.translation import gettext_lazy as _

from experiments.definition.steps.instructions import InstructionPage
from experiments.participation import progress
from experiments.participation.step_page import StepPage
from surveys.documents import spoken

PICTURES = frozenset(
    path.stem for path in (settings.BASE_DIR / "static" / "img" / "instructions").glob("*.svg")
)


class InstructionsStepPage(StepPage):
    """Instructions."""

    label = _("Instructions")
    blank = {"leaves": []}

    def is_done(self) -> bool:
        """Tell whether no page is for the robots of this participant."""
        return not self.pages()

    def show(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Show the page that is asked for."""
        participant, pages = self.participant, self.pages()
        asked = request.GET.get("leaf", "1")
        number = (
            min(max(int(asked), 1), len(pages))
            if asked.isascii() and asked.isdigit() and len(asked) < len("1000")
            else 1
        )
        page = pages[number - 1]
        more = {
            "text": spoken(page.text, self.language(request)),
            "picture": f"img/instructions/{page.picture}.svg" if page.picture in PICTURES else "",
            "leaf": number,
            "leaves": len(pages),
            "before": number - 1,
            "after": number + 1 if number < len(pages) else None,
            "may_skip": participant.visit > 1 or participant.round > 0,
        }
        return self.render(request, "experiments/instructions.html", more)

    def preview(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Show them, or that there are none."""
        if not self.pages():
            return self.render(request, "experiments/trouble.html", {"trouble": "instructions"})
        return self.show(request, now)

    def pages(self) -> tuple[InstructionPage, ...]:
        """Return the pages that are for the robots that the participant may drive."""
        robots = {condition.robot for condition in progress.open_conditions(self.participant)}
        return tuple(
            page for page in self.step.leaves if not page.robot or robots.intersection(page.robot)
        )

    def take(self, request: HttpRequest, now: datetime.datetime) -> bool:
        """Lead on whoever has read them."""
        return True
