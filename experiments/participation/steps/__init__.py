"""The pages of study steps, by name: each module of this package has the page of the step whose
definition has the same name in experiments/definition/steps/.
"""

from functools import cache

from experiments.definition.step import Step
from experiments.models import Participant
from experiments.participation.step_page import StepPage
from surveys.registry import family


class UnknownStepError(LookupError):
    """No module of this package has that name."""


@cache
def _pages() -> dict[str, type[StepPage]]:
    return family(__name__, __path__, StepPage)


def page_type(kind: str) -> type[StepPage]:
    """Return the class of a kind's page.

    Raises:
        UnknownStepError: there is none.
    """
    if kind not in _pages():
        raise UnknownStepError(f"there is no page for a study step {kind!r}")
    return _pages()[kind]


def page_of(participant: Participant, step: Step) -> StepPage:
    """Return the page of a step in front of a participant.

    Raises:
        UnknownStepError: its kind has none.
    """
    return page_type(step.kind)(participant, step)
