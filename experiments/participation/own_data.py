"""What people may do with their own data: read it, take part no longer, and have it deleted. What
stays of a participant who withdraws is in withdrawal.py.
"""

import datetime
from typing import Any

from django.contrib.auth import SESSION_KEY
from django.contrib.sessions.models import Session as BrowserSession

from accounts import audit
from experiments.models import Participant
from experiments.participation import progress
from experiments.participation.withdrawal import withdraw
from sessions.models import Session
from surveys.models import Response

# --- to read --------------------------------------------------------------------------------------


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
        "title": one.study.title,
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
            {"type": e.type, "source": e.source, "stamp": e.stamp, "data": e.data}
            for e in row.events.order_by("received_at")
        ],
    }


def _iso(at: datetime.datetime | None) -> str | None:
    return at.isoformat() if at is not None else None


# --- to leave, and to delete ----------------------------------------------------------------------


def leave(participant: Participant, now: datetime.datetime) -> None:
    """Take somebody out of a study by their own wish. The account of a guest goes with their last
    study, because it is good for nothing else.
    """
    user = participant.user
    withdraw(participant, now)
    if user is not None and user.is_guest and not progress.of_user(user).exists():
        delete_everything(user, now)


def is_driving(user: Any) -> bool:
    """Tell whether somebody is on a robot, or waits for one, right now."""
    return Session.objects.filter(visitor=user).exclude(state=Session.State.ENDED).exists()


def delete_everything(user: Any, now: datetime.datetime) -> bool:
    """Delete an account and all that was recorded of it; False when a drive still lives, or it is
    the account of somebody who runs the site.
    """
    if is_driving(user) or user.is_staff:
        return False
    for participant in progress.of_user(user):
        withdraw(participant, now)
    audit.note("account_deleted", actor=user, person=user, at=now)
    _end_browser_sessions(user)
    user.delete()
    return True


def _end_browser_sessions(user: Any) -> None:
    """End the sessions of somebody's browsers on every device: each holds the user's id, and what
    else a page has put there.
    """
    for session in BrowserSession.objects.iterator():
        if session.get_decoded().get(SESSION_KEY) == str(user.pk):
            session.delete()
