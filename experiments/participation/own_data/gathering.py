"""All data of a user, for them to read."""

import datetime
from typing import Any

from experiments.coding import store
from experiments.models import Coding, Contact, Drive, Participant
from experiments.participation import progress
from sessions.models import Session
from surveys.models import Response

OF_OPERATORS = "wizard_"  # prefix of the types of a hidden operator's events
# The fields of each kind of row; `key=name` is a field with another name in the file.
FIELDS = {
    "account": (
        "username kind email displayName=display_name joined=date_joined lastLogin=last_login"
    ),
    "study": "version study=slug title=shown_title",
    "participation": (
        "code status language age recruitment cell completion recruitmentId=recruitment_id "
        "came=created_at finished=finished_at completionCode=completion_code"
    ),
    "consent": (
        "step version language text guardian sharing sharingText=sharing_text agreed=agreed_at"
    ),
    "draw": "number cell reason levels at",
    "step": "visit round step began=began_at finished=finished_at",
    "appointment": "visit starts=starts_at ends=ends_at reminded=reminded_at",
    "contact": "email given=given_at invited=invite_at",
    "questionnaire": "version questionnaire=slug",
    "response": "askedIn=context_label started=started_at finished=finished_at",
    "answer": "value missing question=item answered=answered_at",
    "session": "outcome device summary queued=queued_at granted=granted_at ended=ended_at",
    "event": "type source stamp",
    "coding": "finished=done_at",
    "code": "code begin end modifiers comment",
}


def gather(user: Any) -> dict[str, Any]:
    """Return all data of a user; of a drive without its states, of which there are thousands."""
    answered = Response.objects.filter(user=user).select_related("questionnaire")
    sessions = Session.objects.filter(visitor=user).select_related("robot")
    return {
        "account": _of("account", user),
        "studies": [_participation(one) for one in progress.of_user(user)],
        "questionnaires": [_response(row) for row in answered.order_by("started_at")],
        "drives": [_session(row) for row in sessions.order_by("queued_at")],
    }


def _of(kind: str, row: Any) -> dict[str, Any]:
    found = {}
    for field in FIELDS[kind].split():
        key, _, name = field.partition("=")
        value = getattr(row, name or key)
        found[key] = value.isoformat() if isinstance(value, datetime.datetime) else value
    return found


def _participation(one: Participant) -> dict[str, Any]:
    contact = Contact.objects.filter(participant=one).first()
    appointments = one.appointments.order_by("starts_at")
    return {
        **_of("study", one.study),
        **_of("participation", one),
        "consents": [_of("consent", row) for row in one.consents.order_by("agreed_at")],
        "draws": [_of("draw", row) for row in one.draws.order_by("number")],
        "steps": [_of("step", row) for row in one.step_visits.order_by("began_at")],
        "appointments": [_of("appointment", row) for row in appointments],
        "reminders": _of("contact", contact) if contact else {},
    }


def _response(row: Response) -> dict[str, Any]:
    return {
        **_of("questionnaire", row.questionnaire),
        **_of("response", row),
        "answers": [_of("answer", answer) for answer in row.answers.order_by("position")],
    }


def _session(row: Session) -> dict[str, Any]:
    # participants learn of a hidden operator in the debriefing
    is_debriefed = not Drive.objects.filter(session=row, participant__completion="").exists()
    return {
        **_of("session", row),
        "id": str(row.pk),
        "robot": row.robot.name,
        "photos": row.snapshots.count(),
        "stateSeconds": row.chunks.count(),
        "networkSamples": row.network_samples.count(),
        "events": [
            {
                **_of("event", event),
                # without the name of the operator, whose data that is
                "data": {name: value for name, value in event.data.items() if name != "by"},
            }
            for event in row.events.order_by("received_at")
            if is_debriefed or not event.type.startswith(OF_OPERATORS)
        ],
        "codings": [_coding(coding) for coding in row.codings.order_by("number")],
    }


def _coding(coding: Coding) -> dict[str, Any]:
    """Return a coder's notes on a drive; coders have numbers instead of names."""
    return {
        **_of("coding", coding),
        "coder": f"C{coding.number}",
        "events": [_of("code", event) for event in store.events_of(coding)],
    }
