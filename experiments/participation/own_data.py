"""What people may do with their own data: read it, take part no longer, and have it deleted.

Whoever withdraws leaves a row without a name: the study, the cell, what became of its place, the
day and the step. So the flow of a study still sums up, and nothing else is left of them. A drive
that still lives is ended at once; it is deleted when the session manager has told everybody so and
closed its record.
"""

import datetime
from typing import Any

from django.utils import timezone

from accounts import audit
from experiments.export import reports
from experiments.models import Drive, Participant, PersonalLink
from experiments.participation import progress, questions
from sessions.leases import store
from sessions.models import Session
from surveys.models import Response

Stage, Status = Participant.Stage, Participant.Status
WITHDRAWN = "withdrawn"  # the reason of a session that was ended by it


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


# --- to withdraw ----------------------------------------------------------------------------------


def withdraw(participant: Participant, now: datetime.datetime) -> None:
    """Take somebody out of a study for good: at any step, also when it is done; a second call does
    nothing more.
    """
    user, exposed = participant.user, _was_exposed(participant)
    if participant.status != Status.WITHDRAWN:
        audit.note(
            "withdrawn",
            actor=user,
            person=user,
            study=participant.study.slug,
            thing=participant,
            at=now,
        )
    rows = Participant.objects.filter(pk=participant.pk).exclude(status=Status.WITHDRAWN)
    rows.update(status=Status.WITHDRAWN, withdrawn_at=now.date(), withdrawn_step=participant.step)
    under_way = Participant.objects.filter(pk=participant.pk, stage=Stage.UNDER_WAY)
    under_way.update(stage=Stage.FILLED if exposed else Stage.FREED)
    if user is not None:
        _end_drives(participant, now)
    _delete_answers(participant)
    clear_settled(now=now)
    Participant.objects.filter(pk=participant.pk).update(
        user=None,
        slot=str(participant.pk),
        recruitment={},
        age=None,
        completion="",
        completion_code="",
        finished_at=None,
    )
    reports.forget(participant.study)
    participant.refresh_from_db()


def leave(participant: Participant, now: datetime.datetime) -> None:
    """Take somebody out of a study by their own wish. The account of a guest goes with their last
    study, because it is good for nothing else.
    """
    user = participant.user
    withdraw(participant, now)
    if user is not None and user.is_guest and not progress.of_user(user).exists():
        delete_everything(user, now)


def _was_exposed(participant: Participant) -> bool:
    return any(
        drive.exposed or drive.session.first_motion_at is not None
        for drive in participant.drives.select_related("session")
    )


def _end_drives(participant: Participant, now: datetime.datetime) -> None:
    for drive in participant.drives.exclude(session__state=Session.State.ENDED):
        store.end(str(drive.session_id), Session.Outcome.CANCELLED, WITHDRAWN, now)


def _delete_answers(participant: Participant) -> None:
    Response.objects.filter(context__startswith=questions.context_of_all(participant)).delete()
    participant.consents.all().delete()
    PersonalLink.objects.filter(participant=participant).update(label="")


def clear_settled(**_more: Any) -> None:
    """Delete the drives of those who withdrew, with all that was recorded, once nobody writes on
    them any more.
    """
    gone = Drive.objects.filter(
        participant__status=Status.WITHDRAWN,
        settled_at__isnull=False,
        session__closed_at__isnull=False,
    )
    Session.objects.filter(pk__in=list(gone.values_list("session", flat=True))).delete()


# --- to delete ------------------------------------------------------------------------------------


def withdraw_everywhere(instance: Any, **_more: Any) -> None:
    """Take somebody out of all their studies: a receiver of Django's signal before an account is
    deleted, by whomever.
    """
    for participant in progress.of_user(instance):
        withdraw(participant, timezone.now())


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
    user.delete()
    return True
