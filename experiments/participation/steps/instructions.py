"""The pages of the instructions, one at a time."""

import datetime

from django.conf import settings
from django.http import HttpRequest, HttpResponseBase
from django.templatetags.static import static
from django.urls import reverse
from django.utils.translation import gettext_lazy as _

from experiments.definition.steps.instructions import OWN_MEDIA, InstructionPage
from experiments.instruction_media import is_video
from experiments.participation import grants, progress
from experiments.participation.step_page import StepPage, to_step

PICTURES = frozenset(
    path.stem for path in (settings.BASE_DIR / "static" / "img" / "instructions").glob("*.svg")
)
EXAMPLES = frozenset({"map", "task"})  # they show a course, which is not that of the study


class InstructionsStepPage(StepPage):
    label = _("Instructions")
    blank = {"leaves": []}

    def is_done(self) -> bool:
        """Tell whether no page is for the robots and conditions of this participant."""
        return not self.pages()

    def show(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Show the requested page. Before instructions with pages for some conditions, participants
        are assigned, or screened out when every cell is full.
        """
        if self.step.named_conditions and grants.draw(self.participant, now) is None:
            progress.screen_out(self.participant, now)
            return to_step(self.participant)
        return self._show(request) if self.pages() else to_step(self.participant)

    def _show(self, request: HttpRequest) -> HttpResponseBase:
        participant, pages = self.participant, self.pages()
        asked, number = request.GET.get("leaf", ""), 1
        if asked.isascii() and asked.isdigit() and len(asked) <= len("100"):
            number = min(max(int(asked), 1), len(pages))
        page = pages[number - 1]
        more = {
            "text": self.filled(page.text, request),
            "picture": _address(page.picture or ""),
            "is_video": is_video(page.picture or ""),
            "is_built_in": page.picture in PICTURES,
            "is_example": page.picture in EXAMPLES,
            "leaf": number,
            "leaves": len(pages),
            "before": number - 1,
            "after": number + 1 if number < len(pages) else None,
            "may_skip": participant.visit > 1 or participant.round > 0,
        }
        return self.render(request, "experiments/instructions.html", more)

    def preview(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        if not self.pages():
            return self.render(request, "experiments/trouble.html", {"trouble": "instructions"})
        return self._show(request)

    def pages(self) -> tuple[InstructionPage, ...]:
        conditions = progress.open_conditions(self.participant)
        robots, keys = {one.robot for one in conditions}, {one.key for one in conditions}
        return tuple(
            page
            for page in self.step.leaves
            if (not page.robot or robots.intersection(page.robot))
            and (not page.conditions or keys.intersection(page.conditions))
        )

    def take(self, request: HttpRequest, now: datetime.datetime) -> bool:
        return True


def _address(picture: str) -> str:
    if picture.startswith(OWN_MEDIA):
        return str(reverse("study_media", args=[picture]))
    return str(static(f"img/instructions/{picture}.svg")) if picture in PICTURES else ""
