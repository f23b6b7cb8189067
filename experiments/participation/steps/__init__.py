"""The pages of study steps, by name: each module of this package has the page of the step whose
definition has the same name in experiments/definition/steps/.

A page is loaded when it is first asked for, because pages lead on by
experiments/participation/progress.py, which asks them in turn what is done.
"""

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from experiments.definition.step import Step
from experiments.definition.steps import KINDS

if TYPE_CHECKING:
    from experiments.models import Participant
    from experiments.participation.step_page import StepPage


class UnknownStepError(LookupError):
    """There is no step of that kind, or it has no page."""


@cache
def page_type(kind: str) -> "type[StepPage]":
    """Return the class of a kind's page.

    Raises:
        UnknownStepError: there is none.
    """
    if kind not in KINDS:
        raise UnknownStepError(f"there is no study step {kind!r}")
    try:
        page: type[StepPage] = import_module(f"{__name__}.{kind}").Page
    except ModuleNotFoundError as error:
        if error.name != f"{__name__}.{kind}":
            raise
        raise UnknownStepError(f"the study step {kind!r} has no page") from error
    return page


def page_of(participant: "Participant", step: Step) -> "StepPage":
    """Return the page of a step in front of a participant.

    Raises:
        UnknownStepError: its kind has none.
    """
    return page_type(step.kind)(participant, step)
