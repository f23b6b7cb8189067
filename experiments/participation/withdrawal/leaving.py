"""To leave a study, or the site. deletion.py says what stays of a participant."""

import datetime
from typing import Any

from django.contrib.auth import SESSION_KEY
from django.contrib.sessions.models import Session as BrowserSession

from accounts import audit
from experiments.models import Participant
from experiments.participation import progress
from experiments.participation.withdrawal.deletion import withdraw
from sessions.models import Session


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
