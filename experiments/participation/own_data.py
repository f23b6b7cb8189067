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
    account = {
        "username": user.username,
        "displayName": user.display_name,
        "kind": user.kind,
        "email": user.email,
        "joined": _iso(user.date_joined),
        "lastLogin": _iso(user.last_login),
    }
    taking_part = [_participation(one) for one in progress.of_user(user)]
    answers = [
        _response(row)
        for row in (
            Response.objects.filter(user=user)
            .select_related("questionnaire")
            .order_by("started_at")
        )
    ]
    visits = [
        _session(row)
        for row in (
            Session.objects.filter(visitor=user).select_related("robot").order_by("queued_at")
        )
    ]
    return {"account": account, "studies": taking_part, "questionnaires": answers, "drives": visits}


def _participation(one: Participant) -> dict[str, Any]:
    consents = one.consents.order_by("agreed_at")
    steps = one.step_visits.order_by("began_at")
    return {
        "study": one.study.slug,
        "version": one.study.version,
        "title": one.study.shown_title,
        "code": one.code,
        "status": one.status,
        "language": one.language,
        "age": one.age,
        "recruitment": one.recruitment,
        "cell": one.cell,
        "came": _iso(one.created_at),
        "finished": _iso(one.finished_at),
        "completion": one.completion,
        "completionCode": one.completion_code,
        "consents": [
            {
                "step": r.step,
                "version": r.version,
                "language": r.language,
                "text": r.text,
                "guardian": r.guardian,
                "agreed": _iso(r.agreed_at),
            }
            for r in consents
        ],
        "steps": [
            {
                "visit": s.visit,
                "round": s.round,
                "step": s.step,
                "began": _iso(s.began_at),
                "finished": _iso(s.finished_at),
            }
            for s in steps
        ],
    }


def _response(row: Response) -> dict[str, Any]:
    answers = row.answers.order_by("position")
    return {
        "questionnaire": row.questionnaire.slug,
        "version": row.questionnaire.version,
        "askedIn": row.context_label,
        "started": _iso(row.started_at),
        "finished": _iso(row.finished_at),
        "answers": [
            {
                "question": a.item,
                "value": a.value,
                "missing": a.missing,
                "answered": _iso(a.answered_at),
            }
            for a in answers
        ],
    }


def _session(row: Session) -> dict[str, Any]:
    return {
        "id": str(row.pk),
        "robot": row.robot.name,
        "queued": _iso(row.queued_at),
        "granted": _iso(row.granted_at),
        "ended": _iso(row.ended_at),
        "outcome": row.outcome,
        "device": row.device,
        "summary": row.summary,
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


def _coding(coding: Coding) -> dict[str, Any]:
    """Return what a coder noted on a drive; the coder has a number."""
    return {
        "coder": f"C{coding.number}",
        "finished": _iso(coding.done_at),
        "events": [
            {
                "code": event.code,
                "begin": event.begin,
                "end": event.end,
                "modifiers": event.modifiers,
                "comment": event.comment,
            }
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


def _iso(at: datetime.datetime | None) -> str | None:
    return at.isoformat() if at is not None else None
