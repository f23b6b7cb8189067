"""The end of a participation, and the code that a participant takes to the recruitment site.

A recruitment site knows one code per ending, the same for all participants and versions of the
study, so researchers see the codes beforehand. Participants who are screened out get a code only
where the study allows it: most sites pay for any code.
"""

import datetime
import hashlib
import hmac

from accounts.passwordless import CODE_LETTERS
from experiments.definition.recruitment.recruiting import ENDINGS, Ending
from experiments.models import CODE_LENGTH, LEFT, Drive, Participant, Study
from experiments.recruitment import appointments, sites
from sessions.leases.absences import faults_of
from sessions.models import Session

BEST_FIRST: tuple[Ending, ...] = ("done", "timed_out", "technical_failure", "left")
TECHNICAL_SIDES = frozenset({"network", "platform", "robot", "operator"})


def code(study: Study, ending: Ending) -> str:
    """Return the code of an ending: that of the definition, or one that this site makes. A study
    without recruitment settings has one code for all who drove.
    """
    recruiting = study.as_definition().recruiting
    if recruiting is None and ending == "timed_out":
        ending = "done"
    own: str = getattr(recruiting.codes, ending) if recruiting is not None else ""
    key = (study.code_key or study.secret).encode()
    digest = hmac.new(key, f"completion {ending}".encode(), hashlib.sha256).digest()
    return own or "".join(CODE_LETTERS[byte % len(CODE_LETTERS)] for byte in digest[:CODE_LENGTH])


def codes(study: Study) -> dict[Ending, str]:
    gives_all = study.as_definition().turned_away_code
    return {one: code(study, one) for one in ENDINGS if gives_all or one != "screened_out"}


def ending_of(participant: Participant) -> Ending:
    """Return the ending of a participant who has reached the end. Each condition counts by its best
    drive. Those who left the drive of one, or never moved the robot in it, have left; a failure
    that was not theirs takes nothing away from the other conditions.
    """
    drives = list(participant.task_drives.select_related("session"))
    sides = {key: fault.side for key, fault in faults_of(one.session for one in drives).items()}
    endings: set[Ending] = set()
    for number in range(max(1, len(participant.conditions))):
        own = [drive for drive in drives if drive.round == number]
        found = [_of_drive(one, sides[one.session_id]) for one in own if one.has_moved]
        best = min(found, key=BEST_FIRST.index) if found else None
        endings.add(best or _without_motion(participant, number, own))
    if "left" in endings:
        return "left"
    fair = endings - {"technical_failure"}
    return min(fair or endings, key=BEST_FIRST.index)


def _of_drive(drive: Drive, side: str) -> Ending:
    """Return the ending of a drive in which the robot moved; `side` is that of the fault."""
    outcome = drive.outcome or drive.session.outcome
    if outcome == "completed":
        return "done"
    if outcome == "timed_out" and (not side or drive.session.outcome != outcome):
        return "timed_out"
    return "technical_failure" if side in TECHNICAL_SIDES else "left"


def has_left_drive(participant: Participant) -> bool:
    """Tell whether a participant who has ended left after moving the robot in the task, also where
    they keep a better ending of an earlier visit.
    """
    has_ended = participant.completion in BEST_FIRST
    return has_ended and has_driven(participant) and ending_of(participant) == LEFT


def has_driven(participant: Participant) -> bool:
    drives = participant.task_drives.select_related("session")
    return any(drive.has_moved for drive in drives)


def _without_motion(participant: Participant, number: int, drives: list[Drive]) -> Ending:
    """Return the ending of a round in which the robot never moved: by its drives, and by the
    sessions that never got the robot.
    """
    sessions = [drive.session for drive in drives]
    task = participant.study.as_definition().task
    if participant.user_id is not None and task is not None:
        waited = Session.objects.filter(visitor=participant.user_id, granted_at=None)
        visits = participant.step_visits.filter(round=number, step=task.key)
        for began, ended in visits.values_list("began_at", "finished_at"):
            own = waited.filter(queued_at__gte=began, ended_at__isnull=False)
            sessions += own.filter(queued_at__lte=ended) if ended else own
    # without a session no robot was available
    sides = {fault.side for fault in faults_of(sessions).values()} or {"platform"}
    if sides & TECHNICAL_SIDES:
        return "technical_failure"
    return "left" if "visitor" in sides else "timed_out"


def conclude(participant: Participant, now: datetime.datetime) -> None:
    """Store that a participant has finished. A later visit can only improve the ending."""
    reached = {ending_of(participant), participant.completion}.intersection(BEST_FIRST)
    ending = min(reached, key=BEST_FIRST.index)
    close(participant, Participant.Status.FINISHED, ending, now)
    appointments.plan_second_session(participant, now)


def close(participant: Participant, status: str, ending: Ending, now: datetime.datetime) -> None:
    """End an active participation, or update one that has ended with this status. Its end is when
    this ending was reached first: a second visit does not make the first one longer.
    """
    given = codes(participant.study).get(ending, "")
    is_reached = participant.completion == ending and participant.finished_at is not None
    ended = participant.finished_at if is_reached else now
    status_in = (Participant.Status.ACTIVE, status)
    rows = Participant.objects.filter(pk=participant.pk, status__in=status_in)
    rows.update(status=status, finished_at=ended, completion=ending, completion_code=given)
    participant.refresh_from_db()


def return_address(participant: Participant, ending: Ending | None = None) -> str:
    reached: Ending = ending or participant.completion
    given = codes(participant.study).get(reached, "") if ending else participant.completion_code
    recruiting = participant.study.as_definition().recruiting
    return sites.return_address(recruiting, participant.recruitment, reached, given)


def on_leaving(participant: Participant) -> tuple[Ending, str]:
    """Return ending and code for a withdrawal; a finished participant keeps theirs, to be paid.
    Those whom no recruitment site sent have no use for the code of leaving.
    """
    if participant.completion:
        return participant.completion, participant.completion_code
    return "left", code(participant.study, "left") if participant.recruitment_id else ""
