"""The questionnaires of a study: which one a step asks, and a participant's response to it at a
place.

The context of a response names participant and place, so that each is answered once: questions
about the person once for good, all others once a visit and round.
"""

import datetime
import secrets
from dataclasses import asdict
from functools import cache, partial

from django.db import transaction
from django.urls import reverse

from experiments.definition.recruitment import piping, recruiting
from experiments.definition.step import AskingStep
from experiments.models import Participant, StepResponse
from experiments.participation import progress
from experiments.participation.drive_status import DriveStatus, series_of
from experiments.participation.journey import JourneyPlace
from experiments.recruitment import screening
from surveys import questionnaires, responses
from surveys.definition import Definition
from surveys.documents import spoken
from surveys.models import SEED_LIMIT, Questionnaire as Row, Response
from surveys.outer_progress import OuterProgress
from surveys.responses import Context, Respondent

CONTEXT = "study"


def context_of_all(participant: Participant) -> str:
    return f"{CONTEXT}/{participant.pk}/"


def context_key(participant: Participant, place: JourneyPlace, step: AskingStep) -> str:
    return context_of_all(participant) + asked_at(place, step).word


def asked_at(place: JourneyPlace, step: AskingStep) -> JourneyPlace:
    """Return the place to which a response belongs: one about the person is given once for good."""
    return JourneyPlace(1, 0, place.step) if step.is_about_person else place


def is_answered(participant: Participant, place: JourneyPlace, step: AskingStep) -> bool:
    return Response.objects.filter(
        context=context_key(participant, place, step),
        questionnaire__slug=step.questionnaire,
        finished_at__isnull=False,
    ).exists()


def definition_of(step: AskingStep) -> Definition:
    """Return the questionnaire of a step: a stored version, else one that comes with the site;
    Row.DoesNotExist when there is none.
    """
    row = _stored(step)
    if row is not None:
        return row.as_definition()
    definition = questionnaires.shipped().get(step.questionnaire)
    if definition is None or definition.version != step.version:
        raise Row.DoesNotExist(f"no questionnaire {step.questionnaire} {step.version}")
    return definition


def _stored(step: AskingStep) -> Row | None:
    return Row.objects.filter(slug=step.questionnaire, version=step.version).first()


def ask(
    participant: Participant,
    place: JourneyPlace,
    step: AskingStep,
    *,
    drive: DriveStatus,
    now: datetime.datetime,
) -> Response:
    """Return a participant's response at a place about a drive, begun at the first call. Raises
    Row.DoesNotExist without such a questionnaire, BadDefinitionError for a template.
    """
    key = context_key(participant, place, step)
    label = f"{participant.study.title} · {step.key} · {participant.code}"
    robot = (drive.robot.name, series_of(drive.robot)) if drive.robot is not None else ()
    return_to = reverse("study_step", args=[participant.study.slug])
    context = Context(key, label, robot=robot, outcome=drive.outcome, return_to=return_to)
    fields = {"participant": participant, **asdict(asked_at(place, step))}
    respondent, seed = Respondent(user=participant.user), secrets.randbelow(SEED_LIMIT)
    with transaction.atomic():
        row = _stored(step) or questionnaires.store(definition_of(step), now)
        response = responses.begin(
            row, respondent, context, language=participant.language, seed=seed, now=now
        )
        StepResponse.objects.get_or_create(response=response, defaults=fields)
    return response


def with_answers(participant: Participant, text: str, *, language: str) -> str:
    """Fill a participant's answers into a text (definition/recruitment/piping.py)."""
    if not piping.has_piping(text):
        return text
    newest = cache(partial(screening.newest_finished, participant))

    def answer(questionnaire: str, item: str) -> str:
        asked = newest(questionnaire)
        return "" if asked is None else _in_words(asked.response, item, language)

    return piping.filled(text, answer)


def operator_text(participant: Participant, language: str) -> str:
    """Return the debriefing about a hidden operator, for participants who may have met one: who
    have begun the task in a condition with an operator, or reached the end of the study.
    """
    definition, keys = participant.study.as_definition(), participant.conditions
    if participant.status != Participant.Status.FINISHED:
        begun = set(participant.task_drives.values_list("round", flat=True))
        keys = [key for number, key in enumerate(keys) if number in begun]
    if not any(map(definition.wizard_of, keys)):
        return ""
    language = progress.language_of(definition, language)
    return with_answers(participant, spoken(definition.operator_text, language), language=language)


def _in_words(response: Response, item: str, language: str) -> str:
    question = response.questionnaire.as_definition().question(item)
    given = response.given().get(item)
    if question is None or given is None or given.value is None:
        return ""
    labels = {value: spoken(label, language) for value, label in question.labelled_values}
    chosen = given.value if isinstance(given.value, list) else [given.value]
    return ", ".join(labels.get(one) or recruiting.as_text(one) for one in chosen)


def outer_progress(response: Response, language: str) -> OuterProgress | None:
    """Return the progress in the study around a response; None when it is not the participant's
    current step (surveys.outer_progress.register_outer_progress).
    """
    rows = StepResponse.objects.filter(response=response).select_related("participant__study")
    asked = rows.first()
    if asked is None or asked.step != asked.participant.step:
        return None
    return progress_around(asked.participant, language)


def progress_around(participant: Participant, language: str) -> OuterProgress:
    definition = participant.study.as_definition()
    spoken_in = progress.language_of(definition, language)
    number, total = progress.step_count(participant)
    study_title = spoken(definition.title, spoken_in)
    step_title = spoken(progress.step_of(participant).title, spoken_in)
    fill = partial(with_answers, participant, language=spoken_in)
    return OuterProgress(study_title, number, total, step_title, fill=fill)
