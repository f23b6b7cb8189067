"""How taking part ended, and the code that says so to whoever recruited the participant.

A recruiting site is told one code a way of ending, the same for everybody, so the codes of a study
follow from its secret and are shown to its researchers beforehand. Participants who are turned away
get a code only where the study says so: most sites pay for any code that a participant brings.
"""

import datetime
import hashlib
import hmac

from django.db.models import Q

from accounts.passwordless import CODE_LETTERS
from experiments.models import (
    CODE_LENGTH,
    DONE,
    SCREENED_OUT,
    TECHNICAL_FAILURE,
    Drive,
    Participant,
    Study,
)

WAYS = (DONE, TECHNICAL_FAILURE, SCREENED_OUT)
# Endings that are the system's, not the visitor's.
TECHNICAL = frozenset(
    {"connection_refused", "connection_lost", "robot_fault", "stopped_by_operator"}
)


def code(study: Study, way: str) -> str:
    """Return the code of a way of ending: one of WAYS."""
    digest = hmac.new(study.secret.encode(), f"completion {way}".encode(), hashlib.sha256).digest()
    return "".join(CODE_LETTERS[byte % len(CODE_LETTERS)] for byte in digest[:CODE_LENGTH])


def codes(study: Study) -> dict[str, str]:
    """Return the codes that participants of a study can get, by way of ending."""
    gives_all = study.as_definition().turned_away_code
    return {way: code(study, way) for way in WAYS if gives_all or way != SCREENED_OUT}


def way_of(participant: Participant) -> str:
    """Return how a participant who came to the end took part: done once a drive moved the robot and
    did not end by a failure.
    """
    practice = participant.study.as_definition().practice_keys
    moved = Q(moved=True) | Q(session__first_motion_at__isnull=False)
    drives = (
        Drive.objects.filter(moved, participant=participant)
        .exclude(step__in=practice)
        .select_related("session")
    )
    return (
        DONE
        if any((drive.outcome or drive.session.outcome) not in TECHNICAL for drive in drives)
        else TECHNICAL_FAILURE
    )


def conclude(participant: Participant, now: datetime.datetime) -> None:
    """Note that a participant is through; a later visit makes good what failed before, and takes
    nothing back.
    """
    way = DONE if participant.completion == DONE else way_of(participant)
    close(participant, Participant.Status.FINISHED, way, now)


def close(participant: Participant, status: str, way: str, now: datetime.datetime) -> None:
    """End a participation that is under way."""
    rows = Participant.objects.filter(
        pk=participant.pk, status__in=(Participant.Status.ACTIVE, status)
    )
    given = codes(participant.study).get(way, "")
    rows.update(status=status, finished_at=now, completion=way, completion_code=given)
    participant.refresh_from_db()
