"""Filled-in questionnaires as the responses of a dataset: how every question stands, in written
order.
"""

from collections.abc import Iterator, Mapping, Sequence

from experiments.dataset.levels import WITHHELD
from experiments.dataset.records import ResponseRecord
from experiments.extraction.people import Round, people_of
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.extraction.selection import Selection
from experiments.models import Participant, Study
from surveys import questionnaires
from surveys.answers import AnswerValue
from surveys.definition import Definition
from surveys.downloads import answered
from surveys.item import Question
from surveys.models import Answer
from surveys.models import Questionnaire as QuestionnaireRow
from surveys.models import Response as Row

AT_ONCE = 200  # participants, whose responses are asked for in one query


def responses_of(
    study: Study, sessions: Mapping[Round, str], names: Pseudonyms, choice: Selection
) -> Iterator[ResponseRecord]:
    """Yield the responses that were given in a study, participant by participant; `sessions` has
    the code of each round's drive.
    """
    people = list(people_of(study, choice).exclude(status=Participant.Status.WITHDRAWN))
    asking = study.as_definition().asking
    repeated, slugs = (
        {step.key: not step.is_about_person for step in asking},
        {step.questionnaire for step in asking},
    )
    for start in range(0, len(people), AT_ONCE):
        known = {str(one.pk): one for one in people[start : start + AT_ONCE]}
        found: dict[str, list[ResponseRecord]] = {key: [] for key in known}
        rows = Row.objects.filter(
            asked_at__participant__in=list(known),
            asked_at__step__in=list(repeated),
            questionnaire__slug__in=slugs,
        ).select_related("asked_at")
        for row, definition, answers in answered(rows):
            place = row.asked_at
            who = known[str(place.participant_id)]
            round_of = (who.pk, place.visit, place.round)
            is_about_drive = repeated[place.step]
            session = sessions.get(round_of, "") if is_about_drive else ""
            is_exact = is_about_drive or not choice.public
            found[str(who.pk)].append(
                _response(
                    row, definition, answers, who.code, session, names, choice, is_exact=is_exact
                )
            )
        for own in found.values():
            yield from own


def _response(
    row: Row,
    definition: Definition,
    answers: Sequence[Answer],
    who: str,
    session: str,
    names: Pseudonyms,
    choice: Selection,
    *,
    is_exact: bool,
) -> ResponseRecord:
    stands = row.response_statuses(definition, {answer.item: answer.given for answer in answers})
    values, missing = {}, {}
    for question in definition.questions():
        value, reason = _said(question, stands[question.key], choice, is_exact=is_exact)
        if reason:
            missing[question.key] = reason
        else:
            values[question.key] = value
    seconds = {answer.item: answer.seconds for answer in answers if answer.seconds is not None}
    order = [key for key in (*values, *missing) if key in seconds]
    return ResponseRecord(
        names.response(row.pk),
        row.questionnaire.slug,
        who,
        values,
        version=row.questionnaire.version,
        session=session,
        finished=row.finished_at is not None,
        missing=missing,
        seconds={key: seconds[key] for key in order},
    )


def _said(
    question: Question, given: AnswerValue, choice: Selection, *, is_exact: bool
) -> tuple[object, str]:
    """Return the value of an answer, or why it has none; without `is_exact`, what is not chosen
    from a list (an age, a year of birth) is withheld as free text is.
    """
    if given.value is None:
        return None, str(given.missing or "")
    if question.item.is_free_text and not choice.has_text:
        return None, WITHHELD
    if not is_exact and not question.labelled_values:
        return None, WITHHELD
    return given.value, ""


def questionnaires_of(study: Study) -> tuple[Definition, ...]:
    """Return the questionnaires of a study in every finished version that is there, by name and
    version.
    """
    slugs = {step.questionnaire for step in study.as_definition().asking}
    rows = QuestionnaireRow.objects.filter(
        slug__in=sorted(slugs | {study.as_definition().analysis.statements})
    )
    finished = [row.as_definition() for row in rows if not questionnaires.problems_of(row)]
    return tuple(sorted(finished, key=lambda one: f"{one.slug}-{one.version}.json"))
