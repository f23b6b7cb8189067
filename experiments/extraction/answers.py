"""Filled-in questionnaires as the responses of a dataset."""

from collections.abc import Iterator, Mapping, Sequence

from experiments.dataset.levels import WITHHELD
from experiments.dataset.records import ResponseRecord
from experiments.definition.factors import steps_about_drive
from experiments.extraction.people import Round, people_of
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.extraction.selection import Selection
from experiments.models import Participant, Study
from surveys import questionnaires
from surveys.definition import Definition
from surveys.downloads import answered
from surveys.models import Answer, Questionnaire as QuestionnaireRow, Response as Row

AT_ONCE = 200  # participants whose responses one query returns


def responses_of(
    study: Study, sessions: Mapping[Round, str], names: Pseudonyms, choice: Selection
) -> Iterator[ResponseRecord]:
    """Yield a study's responses by participant; `sessions` has the code of each round's drive."""
    people = list(people_of(study, choice).exclude(status=Participant.Status.WITHDRAWN))
    asking = study.as_definition().questionnaire_steps
    about_person = {step.key: step.is_about_person for step in asking}
    about_drive = steps_about_drive(study.as_definition())
    for start in range(0, len(people), AT_ONCE):
        known = {str(one.pk): one for one in people[start : start + AT_ONCE]}
        order = {key: place for place, key in enumerate(known)}
        rows = Row.objects.filter(
            asked_at__participant__in=list(known),
            asked_at__step__in=list(about_person),
            questionnaire__slug__in={step.questionnaire for step in asking},
        ).select_related("asked_at")
        by_person = sorted(
            answered(rows), key=lambda found: order[str(found[0].asked_at.participant_id)]
        )
        for row, definition, answers in by_person:
            place = row.asked_at
            person = known[str(place.participant_id)]
            is_exact = not (about_person[place.step] and choice.public)
            values, missing = _stated(row, definition, answers, choice, is_exact=is_exact)
            seconds = {one.item: one.seconds for one in answers if one.seconds is not None}
            session = sessions.get((person.pk, place.visit, place.round), "")
            yield ResponseRecord(
                names.response(row.pk),
                row.questionnaire.slug,
                person.code,
                values,
                version=row.questionnaire.version,
                session=session if place.step in about_drive else "",
                step=place.step,
                finished=row.finished_at is not None,
                missing=missing,
                seconds={key: seconds[key] for key in (*values, *missing) if key in seconds},
            )


def _stated(
    row: Row,
    definition: Definition,
    answers: Sequence[Answer],
    choice: Selection,
    *,
    is_exact: bool,
) -> tuple[dict[str, object], dict[str, str]]:
    """Return the values of a response, and the reasons for which others are missing, both in
    written order. Without `is_exact`, answers that are not chosen from a list (an age, a year of
    birth) are withheld as free text is.
    """
    statuses = row.response_statuses(definition, {answer.item: answer.given for answer in answers})
    values: dict[str, object] = {}
    missing: dict[str, str] = {}
    for question in definition.questions():
        given = statuses[question.key]
        is_secret = question.item.is_free_text and not choice.has_text
        if given.value is None:
            if given.missing:
                missing[question.key] = str(given.missing)
            else:
                values[question.key] = None
        elif is_secret or not (is_exact or question.labelled_values):
            missing[question.key] = WITHHELD
        else:
            values[question.key] = given.value
    return values, missing


def questionnaires_of(study: Study) -> tuple[Definition, ...]:
    """Return every finished version of a study's questionnaires, by name and version."""
    definition = study.as_definition()
    slugs = {step.questionnaire for step in definition.questionnaire_steps} | {
        definition.analysis.statements
    }
    rows = QuestionnaireRow.objects.filter(slug__in=sorted(slugs))
    finished = [row.as_definition() for row in rows if not questionnaires.problems_of(row)]
    return tuple(sorted(finished, key=lambda one: f"{one.slug}-{one.version}.json"))
