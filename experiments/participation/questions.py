"""The questionnaires of a study: which one a step asks, and a participant's response to it at a
place.

The context of a response names participant and place, so that each is answered once: questions
about the person once for good, all others once a visit and round.
"""

import datetime
import secrets
from functools import partial

from django.db import transaction

from experiments.definition.recruitment import piping, recruiting
from experiments.definition.step import AskingStep
from experiments.models import Participant, StepResponse
from experiments.participation import progress
from experiments.participation.journey import JourneyPlace
from surveys import questionnaires, responses
from surveys.definition import Definition
from surveys.documents import spoken
from surveys.models import SEED_LIMIT, Response
from surveys.models import Questionnaire as Row
from surveys.outer_progress import OuterProgress
from surveys.responses import Context, Respondent

CONTEXT = "study"


def context_of_all(participant: Participant) -> str:
    """Return how the contexts of all of a participant's responses begin."""
    return f"{CONTEXT}/{participant.pk}/"


def context_key(participant: Participant, place: JourneyPlace, step: AskingStep) -> str:
    """Return the context of a response."""
    return context_of_all(participant) + asked_at(place, step).word


def asked_at(place: JourneyPlace, step: AskingStep) -> JourneyPlace:
    """Return the place to which a response belongs: one about the person is asked once for good."""
    return JourneyPlace(1, 0, place.step) if step.is_about_person else place


def is_answered(participant: Participant, place: JourneyPlace, step: AskingStep) -> bool:
    """Tell whether the questions of a step are answered to the end."""
    given = Response.objects.filter(
        context=context_key(participant, place, step), questionnaire__slug=step.questionnaire
    )
    return given.filter(finished_at__isnull=False).exists()


def questionnaire_of(step: AskingStep, now: datetime.datetime) -> Row:
    """Return the version that a step asks; one that comes with the site is put into the database if
    it is not there yet.

    Raises:
        Row.DoesNotExist: nobody knows it.
    """
    row = Row.objects.filter(slug=step.questionnaire, version=step.version).first()
    return row if row is not None else questionnaires.store(definition_of(step), now)


def definition_of(step: AskingStep) -> Definition:
    """Return what a step asks, without putting anything into the database.

    Raises:
        Row.DoesNotExist: nobody knows it.
    """
    row = Row.objects.filter(slug=step.questionnaire, version=step.version).first()
    definition = (
        row.as_definition() if row is not None else questionnaires.shipped().get(step.questionnaire)
    )
    if definition is None or definition.version != step.version:
        raise Row.DoesNotExist(f"no questionnaire {step.questionnaire} {step.version}")
    return definition


def ask(
    participant: Participant,
    place: JourneyPlace,
    step: AskingStep,
    *,
    robot: tuple[str, ...],
    outcome: str,
    return_to: str,
    now: datetime.datetime,
) -> Response:
    """Return a participant's response at a place, begun at the first call. `robot` are the words by
    which the one that was driven goes.

    Raises:
        Row.DoesNotExist: nobody knows the questionnaire.
        BadDefinitionError: it is a template.
    """
    context = Context(
        key=context_key(participant, place, step),
        label=f"{participant.study.title} · {step.key} · {participant.code}",
        robot=robot,
        outcome=outcome,
        return_to=return_to,
    )
    seed = secrets.randbelow(SEED_LIMIT)
    respondent = Respondent(user=participant.user)
    with transaction.atomic():
        response = responses.begin(
            questionnaire_of(step, now),
            respondent,
            context,
            language=participant.language,
            seed=seed,
            now=now,
        )
        where = asked_at(place, step)
        fields = {"visit": where.visit, "round": where.round, "step": where.step}
        StepResponse.objects.get_or_create(
            response=response, defaults={"participant": participant, **fields}
        )
    return response


# --- answers in later texts -----------------------------------------------------------------------


def with_answers(participant: Participant, text: str, *, language: str) -> str:
    """Return a text of the study with the participant's answers filled in
    (experiments/definition/recruitment/piping.py).
    """
    if not piping.has_piping(text):
        return text
    found: dict[str, StepResponse | None] = {}

    def answer(questionnaire: str, item: str) -> str:
        if questionnaire not in found:
            rows = StepResponse.objects.filter(
                participant=participant,
                response__questionnaire__slug=questionnaire,
                response__finished_at__isnull=False,
            ).select_related("response__questionnaire")
            found[questionnaire] = rows.order_by("-response__finished_at").first()
        asked = found[questionnaire]
        return "" if asked is None else _said(asked.response, item, language)

    return piping.filled(text, answer)


def _said(response: Response, item: str, language: str) -> str:
    """Return an answer in words: the labels of what was chosen, else what was written."""
    question = response.questionnaire.as_definition().question(item)
    given = response.given().get(item)
    if question is None or given is None or given.value is None:
        return ""
    labels = {value: spoken(label, language) for value, label in question.labelled_values}
    chosen = given.value if isinstance(given.value, list) else [given.value]
    return ", ".join(labels.get(one) or recruiting.as_text(one) for one in chosen)


# --- around the page of a questionnaire -----------------------------------------------------------


def outer_progress(response: Response, language: str) -> OuterProgress | None:
    """Return the study in which a response is asked, and the step of a participant who stands on it
    (surveys.outer_progress.register_outer_progress).
    """
    asked = (
        StepResponse.objects.filter(response=response).select_related("participant__study").first()
    )
    if asked is None or asked.step != asked.participant.step:
        return None
    return progress_around(asked.participant, language)


def progress_around(participant: Participant, language: str) -> OuterProgress:
    """Return what goes on around the questionnaire of a participant's step, for its page."""
    definition = participant.study.as_definition()
    spoken_in = progress.language_of(definition, language)
    number, total = progress.step_count(participant)
    step_title = spoken(progress.step_of(participant).title, spoken_in)
    return OuterProgress(
        spoken(definition.title, spoken_in),
        number,
        total,
        step_title,
        fill=partial(with_answers, participant, language=spoken_in),
    )
