"""The pages of study steps, by name: each module of this package has the page of the step whose
definition has the same name in experiments/definition/steps/.
"""

from functools import cache

from experiments.definition.step import Step
from experiments.models import Participant
from experiments.participation.step_page import StepPage
from surveys.registry import family


@cache
def _pages() -> dict[str, type[StepPage]]:
    return family(__name__, __path__, StepPage)


def page_type(kind: str) -> type[StepPage]:
    return _pages()[kind]


def page_of(participant: Participant, step: Step) -> StepPage:
    return page_type(step.kind)(participant, step)
