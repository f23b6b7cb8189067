"""What is kept of somebody, for them to read."""

import datetime
from typing import Any

from experiments.coding import store
from experiments.models import Coding, Drive, Participant
from experiments.participation import progress
from sessions.models import Session
from surveys.models import Response

OF_OPERATORS = "wizard_"  # how the types of a hidden operator's events begin


def gather(user: Any) -> dict[str, Any]:
    """Return all that is kept of somebody, as JSON takes it; the record of a drive by its summary,
    because it has thousands of states.
    """
    account = _told(
        user,
        "username",
        "kind",
        "email",
        displayName="display_name",
        joined="date_joined",
        lastLogin="last_login",
    )
    responses = Response.objects.filter(user=user).select_related("questionnaire")
    visits = Session.objects.filter(visitor=user).select_related("robot")
    return {
        "account": account,
        "studies": [_participation(one) for one in progress.of_user(user)],
        "questionnaires": [_response(row) for row in responses.order_by("started_at")],
        "drives": [_session(row) for row in visits.order_by("queued_at")],
    }


def _told(row: Any, *names: str, **renamed: str) -> dict[str, Any]:
    """Return fields of a row, some of them under another name; times as ISO 8601."""
    fields = {name: name for name in names} | renamed
    found = {name: getattr(row, field) for name, field in fields.items()}
    return {
        name: value.isoformat() if isinstance(value, datetime.datetime) else value
        for name, value in found.items()
    }


def _participation(one: Participant) -> dict[str, Any]:
    own = _told(
        one,
        "code",
        "status",
        "language",
        "age",
        "recruitment",
        "cell",
        "completion",
        came="created_at",
        finished="finished_at",
        completionCode="completion_code",
    )
    consents = [
        _told(
            row,
            "step",
            "version",
            "language",
            "text",
            "guardian",
            "sharing",
            sharingText="sharing_text",
            agreed="agreed_at",
        )
        for row in one.consents.order_by("agreed_at")
    ]
    draws = [
        _told(row, "number", "cell", "reason", "levels", at="at")
        for row in one.draws.order_by("number")
    ]
    steps = [
        _told(row, "visit", "round", "step", began="began_at", finished="finished_at")
        for row in one.step_visits.order_by("began_at")
    ]
    study = {"study": one.study.slug, "version": one.study.version, "title": one.study.shown_title}
    return study | own | {"consents": consents, "draws": draws, "steps": steps}


def _response(row: Response) -> dict[str, Any]:
    answers = [
        _told(one, "value", "missing", question="item", answered="answered_at")
        for one in row.answers.order_by("position")
    ]
    asked = {"questionnaire": row.questionnaire.slug, "version": row.questionnaire.version}
    own = _told(row, askedIn="context_label", started="started_at", finished="finished_at")
    return asked | own | {"answers": answers}


def _session(row: Session) -> dict[str, Any]:
    own = _told(
        row,
        "outcome",
        "device",
        "summary",
        queued="queued_at",
        granted="granted_at",
        ended="ended_at",
    )
    return (
        {"id": str(row.pk), "robot": row.robot.name}
        | own
        | {
            "photos": row.snapshots.count(),
            "stateSeconds": row.chunks.count(),
            "networkSamples": row.network_samples.count(),
            "events": [
                {"type": e.type, "source": e.source, "stamp": e.stamp, "data": _own_part(e.data)}
                for e in row.events.order_by("received_at")
                if not e.type.startswith(OF_OPERATORS) or _is_debriefed(row)
            ],
            "codings": [_coding(coding) for coding in row.codings.order_by("number")],
        }
    )


def _coding(coding: Coding) -> dict[str, Any]:
    """Return what a coder noted on a drive; the coder has a number."""
    events = [
        _told(one, "code", "begin", "end", "modifiers", "comment")
        for one in store.events_of(coding)
    ]
    return {"coder": f"C{coding.number}"} | _told(coding, finished="done_at") | {"events": events}


def _own_part(data: dict[str, Any]) -> dict[str, Any]:
    """Leave out who operated the robot: that is the data of somebody else."""
    return {name: value for name, value in data.items() if name != "by"}


def _is_debriefed(row: Session) -> bool:
    """Tell whether a participant has been told of the hidden operator, of whom they learn first
    from the debriefing.
    """
    return not Drive.objects.filter(session=row, participant__completion="").exists()
