"""Advice above the form of a page of the study builder; it does not prevent publishing."""

import re
from collections.abc import Iterator

from django.utils.translation import gettext as _

from experiments.builder.pages import BuilderPlace
from experiments.definition.schema import StudyDefinition
from experiments.definition.step import AskingStep
from experiments.definition.steps.consent import Consent
from experiments.participation import questions
from surveys.documents import BadDefinitionError, spoken
from surveys.models import Questionnaire

ASKS_AGE = re.compile(
    r"\b(age|how old|(year|date) of birth|edad|cuántos años|(año|fecha) de nacimiento)\b",
    re.IGNORECASE,
)
Advice = tuple[str, BuilderPlace]  # a sentence, and another page where it can be followed


def advice(study: StudyDefinition, place: BuilderPlace, language: str) -> Iterator[Advice]:
    if place.section == "steps" and place.index is not None:
        yield from _on_age(study, place.index, language)
        if study.observers_allowed and isinstance(study.steps[place.index], Consent):
            text = _(
                "Other people may watch the drives of this study. The consent should say that "
                "others can see and hear them."
            )
            yield text, BuilderPlace("about")


def _on_age(study: StudyDefinition, index: int, language: str) -> Iterator[Advice]:
    """The consent page asks the age for its minimum age; a question on the age would repeat it."""
    consent, steps = study.consent, list(study.steps)
    if consent is None or not consent.minimum_age:
        return
    first = steps.index(consent)
    for number, step in enumerate(steps):
        if index not in {number, first} or not isinstance(step, AskingStep):
            continue
        if question := _question_on_age(step, language):
            text = _(
                "Participants are asked for their age twice: on the consent page, because of its "
                "minimum age, and by “%(question)s” in the step “%(step)s”. Set the minimum age "
                "to 0, or use a questionnaire without this question."
            )
            named = {"question": question, "step": spoken(step.title, language) or step.key}
            yield text % named, BuilderPlace("steps", number if index == first else first)


def _question_on_age(step: AskingStep, language: str) -> str:
    try:
        asked = questions.definition_of(step).questions()
    except (Questionnaire.DoesNotExist, BadDefinitionError):
        return ""
    found = (one.text for one in asked if any(map(ASKS_AGE.search, one.text.values())))
    return next((spoken(text, language) for text in found), "")
