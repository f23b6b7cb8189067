"""What is kept of somebody, for them to read."""

import datetime
from typing import Any

from experiments.coding import store
from experiments.models import Coding, Contact, Drive, Participant
from experiments.participation import progress
from sessions.models import Session
from surveys.models import Response

OF_OPERATORS = "wizard_"  # how the types of a hidden operator's events begin


def gather(user: Any) -> dict[str, Any]:
    """Return all that is kept of somebody, as JSON takes it; the record of a drive by its summary,
    because it has thousands of states.
    """
    answered = Response.objects.filter(user=user).select_related("questionnaire")
    driven = Session.objects.filter(visitor=user).select_related("robot")
    return {
        "account": _of(
            user,
            *("username", "kind", "email"),
            displayName="display_name",
            joined="date_joined",
            lastLogin="last_login",
        ),
        "studies": [_participation(one) for one in progress.of_user(user)],
        "questionnaires": [_response(row) for row in answered.order_by("started_at")],
        "drives": [_session(row) for row in driven.order_by("queued_at")],
    }


def _of(row: Any, *names: str, **renamed: str) -> dict[str, Any]:
    """Return fields of a row, some under another name; times as text."""
    found = {
        key: getattr(row, name)
        for key, name in {**dict(zip(names, names, strict=True)), **renamed}.items()
    }
    return {
        key: value.isoformat() if isinstance(value, datetime.datetime) else value
        for key, value in found.items()
    }


def _participation(one: Participant) -> dict[str, Any]:
    contact = Contact.objects.filter(participant=one).first()
    return {
        **_of(one.study, "version", study="slug", title="shown_title"),
        **_of(
            one,
            *("code", "status", "language", "age", "recruitment", "cell", "completion"),
            recruitmentId="recruitment_id",
            came="created_at",
            finished="finished_at",
            completionCode="completion_code",
        ),
        "consents": [
            _of(
                row,
                *("step", "version", "language", "text", "guardian", "sharing"),
                sharingText="sharing_text",
                agreed="agreed_at",
            )
            for row in one.consents.order_by("agreed_at")
        ],
        "draws": [
            _of(row, "number", "cell", "reason", "levels", at="at")
            for row in one.draws.order_by("number")
        ],
        "steps": [
            _of(row, "visit", "round", "step", began="began_at", finished="finished_at")
            for row in one.step_visits.order_by("began_at")
        ],
        "appointments": [
            _of(row, "visit", starts="starts_at", ends="ends_at", reminded="reminded_at")
            for row in one.appointments.order_by("starts_at")
        ],
        "reminders": _of(contact, "email", given="given_at", invited="invite_at")
        if contact
        else {},
    }


def _response(row: Response) -> dict[str, Any]:
    return {
        **_of(row.questionnaire, "version", questionnaire="slug"),
        **_of(row, askedIn="context_label", started="started_at", finished="finished_at"),
        "answers": [
            _of(answer, "value", "missing", question="item", answered="answered_at")
            for answer in row.answers.order_by("position")
        ],
    }


def _session(row: Session) -> dict[str, Any]:
    return {
        **_of(
            row,
            *("outcome", "device", "summary"),
            queued="queued_at",
            granted="granted_at",
            ended="ended_at",
        ),
        "id": str(row.pk),
        "robot": row.robot.name,
        "photos": row.snapshots.count(),
        "stateSeconds": row.chunks.count(),
        "networkSamples": row.network_samples.count(),
        "events": [
            {**_of(event, "type", "source", "stamp"), "data": _own_part(event.data)}
            for event in row.events.order_by("received_at")
            if not event.type.startswith(OF_OPERATORS) or _is_debriefed(row)
        ],
        "codings": [_coding(coding) for coding in row.codings.order_by("number")],
    }


def _coding(coding: Coding) -> dict[str, Any]:
    """Return what a coder noted on a drive; the coder has a number."""
    return {
        **_of(coding, finished="done_at"),
        "coder": f"C{coding.number}",
        "events": [
            _of(event, "code", "begin", "end", "modifiers", "comment")
            for event in store.events_of(coding)
        ],
    }


def _own_part(data: dict[str, Any]) -> dict[str, Any]:
    """Leave out who operated the robot: that is the data of somebody else."""
    return {name: value for name, value in data.items() if name != "by"}


def _is_debriefed(row: Session) -> bool:
    """Tell whether a participant has been told of the hidden operator, of whom they learn first
    from the debriefing.
    """
    return not Drive.objects.filter(session=row, participant__completion="").exists()
